#pragma once

namespace helix_arm::ros_bridge {

/// Exit code of a node.
enum ExitCode {
  kDone = 0,              ///< asked to end (Ctrl-C, rosnode kill), or work done
  kFailed = 1,            ///< the ROS master was lost, or the node failed
  kBadConfiguration = 2,  ///< a parameter or a file breaks its rules; every fault was printed
};

}  // namespace helix_arm::ros_bridge
