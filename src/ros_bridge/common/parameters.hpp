#pragma once

#include <functional>
#include <optional>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include <ros/node_handle.h>
#include <ros/time.h>

#include "helix_arm/LoopStatus.h"
#include "helix_arm/Reload.h"
#include "helix_arm/io/scene.hpp"
#include "helix_arm/model/contraction.hpp"
#include "helix_arm/regulator/config.hpp"

/// Inputs of a node by its user: parameters, files that its services read and write, another scene.
namespace helix_arm::ros_bridge {

/// Where services read and write by default: `helix_arm` below ROS_HOME, which is ~/.ros if unset.
std::string defaultFolder();

/// Reads a node's private parameters and collects their faults: `~name value rule`.
class ParameterReader {
 public:
  explicit ParameterReader(const ros::NodeHandle& private_node) : node_(private_node) {}

  /// Each returns the fallback if the parameter is absent or invalid (noted as a fault).
  std::string text(const std::string& name, const std::string& fallback);
  /// Name of a tf frame or a prefix of one: no leading slash, empty only if the fallback is.
  std::string frame(const std::string& name, const std::string& fallback);
  /// One of these words.
  std::string choice(const std::string& name, const std::string& fallback,
                     const std::vector<std::string>& words);
  bool flag(const std::string& name, bool fallback);
  double number(const std::string& name, double fallback, const model::Range& allowed);
  int count(const std::string& name, int fallback, int lower, int upper);

  /// Path of a file, or the bare name of one that the package ships in `folder` with this
  /// extension. Here and below the result is absolute; a relative path begins in the working
  /// directory of the node.
  std::string file(const std::string& name, const std::string& folder,
                   const std::string& extension);

  /// Path of a folder; the fallback if the parameter is absent or empty.
  std::string folder(const std::string& name, const std::string& fallback) {
    const std::string given = text(name, "");
    return given.empty() ? fallback : absolute(name, given);
  }

  /// The same path, absolute; a relative one must lead to what is there.
  /// @param given  the value of the parameter, not empty.
  std::string absolute(const std::string& name, const std::string& given);

  /// Warns of parameters that were set but never read, most often misspelt ones.
  /// @throws std::invalid_argument with every fault noted so far, one per line, if there are any.
  void finish();

 private:
  using Value = XmlRpc::XmlRpcValue;

  /// @param take  the value of what breaks no rule.
  template <class T>
  T value(const std::string& name, const T& fallback, const std::string& rule,
          const std::function<std::optional<T>(Value&)>& take);
  void fault(const std::string& name, const Value& value, const std::string& rule);

  ros::NodeHandle node_;
  std::set<std::string> known_;
  std::vector<std::string> faults_;
};

// Requirements on scenes of nodes that use the arm's pressures.

/// The scene, if all of its actuators are driven by pressure.
/// @throws std::invalid_argument naming the others.
io::Scene requirePneumatic(io::Scene scene);

/// @throws std::invalid_argument if the scene has no regulator.
const regulator::Config& requireRegulator(const io::Scene& scene);

/// Warns of actuators whose limits the supply of the scene's simulated regulator does not reach.
void warnOfShortSupply(const io::Scene& scene);

/// A folder, and the parameter that names it, such as "~scene_folder".
struct SceneFolder {
  std::string path, parameter;
};
/// Path, without links, of a scene file that a client names, which may be any path.
/// @throws std::invalid_argument if it is not absolute, or no regular .yaml file below the folders,
/// to which links must lead. The message does not reveal whether a path elsewhere exists.
std::string sceneBelow(const std::vector<SceneFolder>& folders, const std::string& given);

/// Whether visual_servo commands the arm, so that pressure_command and vision keep the scene that
/// it refuses to change. For the thread of the node's callback queue.
class LoopWatch {
 public:
  explicit LoopWatch(ros::NodeHandle& node);
  /// @throws std::invalid_argument while it follows a path or a target; its hold ends by a reload.
  void requireFree() const;

 private:
  void onStatus(const LoopStatusConstPtr& status);

  ros::SteadyTime commanded_;  ///< last; zero: not yet
  ros::Subscriber subscriber_;
};

/// Serves a node's `~reload`: loads another file of the same rig, for example after a calibration.
///
/// The file is loaded and checked before anything changes; its faults are the answer.
class ReloadServer {
 public:
  /// Replaces the node's scene; or throws a std::exception with the reason and changes nothing.
  using Adopt = std::function<void(io::Scene)>;

  /// @param private_node  of the node.
  /// @param path          path of the node's present scene.
  /// @param scene_folder  from which scenes are accepted, besides the shipped and the node's own.
  /// @param adopt         called from the callback queue.
  ReloadServer(ros::NodeHandle private_node, std::string path, std::string scene_folder,
               Adopt adopt);

 private:
  bool onReload(const Reload::Request& request, Reload::Response& response);
  /// The file that a request means.
  /// @throws std::invalid_argument if the node does not accept it.
  std::string allowed(const std::string& scene) const;

  const std::string first_path_, scene_folder_;
  std::string path_;  ///< of the node's present scene
  Adopt adopt_;
  ros::ServiceServer server_;
};

}  // namespace helix_arm::ros_bridge
