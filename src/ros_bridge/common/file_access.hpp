#pragma once

#include <filesystem>
#include <string>
#include <utility>
#include <vector>

namespace helix_arm::ros_bridge {

/// Where services read and write by default: `helix_arm` below ROS_HOME, which is ~/.ros if it is
/// not set.
std::string defaultFolder();

/// Restricts the files that a node's services read to some folders, since any client may name any
/// path. The target of a link counts, not the link's location.
class FileAccess {
 public:
  /// A folder, and the parameter that names it, such as "~scene_folder".
  struct Folder {
    std::string path, parameter;
  };

  explicit FileAccess(std::vector<Folder> folders) : folders_(std::move(folders)) {}

  /// @param what     name of the file in messages, such as "data".
  /// @param given    an absolute path.
  /// @param endings  allowed endings, such as ".csv".
  /// @return its path without links.
  /// @throws std::invalid_argument if it is no regular file with such an ending below the folders.
  /// The message does not reveal whether a path elsewhere exists.
  std::string toRead(const std::string& what, const std::string& given,
                     const std::vector<std::string>& endings) const;

 private:
  std::vector<Folder> folders_;
};

/// Folder in which the user called this node, or the roslaunch that started it: where a relative
/// path begins.
///
/// That is the working directory, unless it is ROS_HOME, in which roslaunch starts nodes. Then it
/// is the working directory of that roslaunch; and where this cannot be found, PWD, which a node
/// has from the shell in which roslaunch was called.
std::filesystem::path callersFolder();

}  // namespace helix_arm::ros_bridge
