#pragma once

#include <filesystem>

namespace helix_arm::ros_bridge {

/// Folder in which the user called this node, or the roslaunch that started it: where a relative
/// path begins.
///
/// That is the working directory, unless it is ROS_HOME, in which roslaunch starts nodes. Then it
/// is the working directory of that roslaunch; and where this cannot be found, PWD, which a node
/// has from the shell in which roslaunch was called.
std::filesystem::path callersFolder();

}  // namespace helix_arm::ros_bridge
