#pragma once

namespace helix_arm::ros_bridge {

/// Request to end a node: by Ctrl-C, SIGTERM, rosnode kill, or from within. It does not shut ROS
/// down: the node can first do its work, such as venting an arm, without the ROS master, which may
/// hang. spinUntilEnd() handles the request.
class EndRequest {
 public:
  /// Replaces roscpp's handlers; its node must have been started.
  EndRequest();

  /// Makes the request, from any thread.
  static void make();
  /// True once the request was made.
  static bool made();
  /// True if the node should not finish its work first: it was asked twice, or from within.
  static bool isUrgent();
};

}  // namespace helix_arm::ros_bridge
