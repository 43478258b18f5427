#pragma once

#include <functional>
#include <string>

#include <ros/node_handle.h>

#include "helix_arm/Reload.h"
#include "helix_arm/basics/mutex.hpp"
#include "helix_arm/io/scene.hpp"

namespace helix_arm::ros_bridge {

/// Serves a node's `~reload`: loads another file of the same rig at run time, for example after a
/// calibration.
///
/// The file is loaded and checked before anything changes; its faults are the answer.
class ReloadServer {
 public:
  /// Replaces the node's scene completely; or throws a std::exception with the reason and changes
  /// nothing.
  using Adopt = std::function<void(io::Scene)>;

  /// @param private_node  of the node.
  /// @param path          path of the node's present scene.
  /// @param scene_folder  folder from which scenes are accepted, besides those that the package
  ///                      ships and the node's own.
  /// @param adopt         called from the callback queue while file() waits: it must not call
  ///                      file(), nor lock a mutex that is locked around a call of file().
  ReloadServer(ros::NodeHandle private_node, std::string path, std::string scene_folder,
               Adopt adopt);

  /// The file of the node's present scene, and the hash of its content when it was loaded.
  /// Thread-safe; waits while a scene is adopted.
  struct File {
    std::string path, sha256;
  };
  File file() const HELIX_ARM_EXCLUDES(mutex_);

 private:
  bool onReload(Reload::Request& request, Reload::Response& response) HELIX_ARM_EXCLUDES(mutex_);
  /// The file that a request means.
  /// @throws std::invalid_argument if the node does not accept it.
  std::string allowed(const std::string& scene) const HELIX_ARM_EXCLUDES(mutex_);

  const std::string first_path_, scene_folder_;
  /// Also locked while a scene is adopted, so that whoever sees the new scene gets the new file.
  mutable basics::Mutex mutex_;
  File file_ HELIX_ARM_GUARDED_BY(mutex_);
  Adopt adopt_;
  ros::ServiceServer server_;
};

}  // namespace helix_arm::ros_bridge
