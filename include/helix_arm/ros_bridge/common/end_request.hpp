#pragma once

namespace helix_arm::ros_bridge {

/// How a node is asked to end: by Ctrl-C, SIGTERM, rosnode kill, or from within. It only asks, and
/// ROS stays up: what the node has to do first, as venting an arm, needs no ROS master then, which
/// may hang. spinUntilEnd() sees to the rest.
class EndRequest {
 public:
  /// Takes over from roscpp, whose node has been started.
  EndRequest();

  /// Asks, from any thread.
  static void make();
  /// True once somebody has asked.
  static bool made();
  /// True once nobody waits for what the node is about: it was asked twice, or from within.
  static bool isUrgent();
};

}  // namespace helix_arm::ros_bridge
