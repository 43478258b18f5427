#pragma once

namespace helix_arm::ros_bridge {

/// Lets a node finish what it is about before it ends: from the making of this object on, Ctrl-C,
/// SIGTERM and rosnode kill only ask; the node itself calls ros::requestShutdown() when it is
/// ready.
///
/// One a process; a second Ctrl-C ends it at once.
class EndRequest {
 public:
  EndRequest();
  /// True once somebody has asked.
  bool made() const;
};

}  // namespace helix_arm::ros_bridge
