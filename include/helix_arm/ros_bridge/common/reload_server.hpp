#pragma once

#include <functional>
#include <string>

#include <ros/node_handle.h>

#include "helix_arm/Reload.h"
#include "helix_arm/basics/mutex.hpp"
#include "helix_arm/io/scene.hpp"

namespace helix_arm::ros_bridge {

/// Answers a node's `~reload`: gives it another file of the same rig while it runs, as after a
/// calibration.
///
/// The file is loaded and checked before anything changes; whatever is wrong with it is the answer.
class ReloadServer {
 public:
  /// Takes the scene's place, total area; or throws a std::exception with the reason and changes
  /// nothing.
  using Adopt = std::function<void(io::Scene)>;

  /// @param private_node  of the node.
  /// @param path          of the scene that the node has.
  /// @param scene_folder  below which scenes are taken, beside those that the package ships, and
  ///                      the node's own.
  /// @param adopt         called from the callback queue.
  ReloadServer(ros::NodeHandle private_node, std::string path, std::string scene_folder,
               Adopt adopt);

  /// The file of the scene that the node has now, and what it held then. From any thread.
  struct File {
    std::string path, sha256;
  };
  File file() const HELIX_ARM_EXCLUDES(mutex_);

 private:
  bool onReload(Reload::Request& request, Reload::Response& response);
  /// The file that a request means.
  /// @throws std::invalid_argument where the node does not take it.
  std::string allowed(const std::string& scene) const;

  const std::string first_path_, scene_folder_;
  mutable basics::Mutex mutex_;
  File file_ HELIX_ARM_GUARDED_BY(mutex_);
  Adopt adopt_;
  ros::ServiceServer server_;
};

/// @throws std::invalid_argument naming what keeps one scene from being of the same rig as the one
/// at hand: other sections, other actuators, or another geometry.
void requireSameRig(const io::Scene& at_hand, const io::Scene& next);

}  // namespace helix_arm::ros_bridge
