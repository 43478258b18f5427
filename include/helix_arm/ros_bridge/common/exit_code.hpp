#pragma once

namespace helix_arm::ros_bridge {

/// What a node's process ends with.
enum ExitCode {
  kDone = 0,              ///< asked to end (Ctrl-C, rosnode kill), or its work is done
  kFailed = 1,            ///< the ROS master was lost, or the node's own verdict
  kBadConfiguration = 2,  ///< a parameter or a file breaks its rules; every fault was printed
};

}  // namespace helix_arm::ros_bridge
