#pragma once

#include <functional>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include <ros/node_handle.h>

#include "helix_arm/io/scene.hpp"
#include "helix_arm/model/contraction.hpp"
#include "helix_arm/regulator/config.hpp"

namespace helix_arm::ros_bridge {

/// Absolute path of a file, or of the one that the package ships in `folder` under this bare name;
/// nothing if the text is neither.
std::optional<std::string> filePath(const std::string& given, const std::string& folder,
                                    const std::string& extension);

/// Reads a node's private parameters and collects their faults: `~name value rule`.
class ParameterReader {
 public:
  explicit ParameterReader(const ros::NodeHandle& private_node) : node_(private_node) {}

  /// Each returns the fallback if the parameter is absent or invalid; the latter is noted as a
  /// fault.
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
  /// extension. Here and below a path may be given relative to callersFolder(); the result, and
  /// from then on the parameter, is absolute, and the log tells it.
  std::string file(const std::string& name, const std::string& folder,
                   const std::string& extension);

  /// Path of a folder; the fallback if the parameter is absent or empty.
  std::string folder(const std::string& name, const std::string& fallback) {
    const std::string given = text(name, "");
    return given.empty() ? fallback : absolute(name, given);
  }

  /// The same path, absolute. @param given  the value of the parameter, not empty.
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

/// Warns of actuators whose limits the supply of the scene's regulator does not reach, if that is
/// simulated.
void warnOfShortSupply(const io::Scene& scene);

}  // namespace helix_arm::ros_bridge
