#pragma once

#include <ros/time.h>

namespace helix_arm::ros_bridge {

/// ROS time while it advances. If it stops, for example because the node that simulates it has
/// ended, a steady clock continues it, so that earlier data still ages.
///
/// Call now() more often than every kPatience.
class MovingClock {
 public:
  static constexpr double kPatience = 2.0;  ///< longest stop of ROS time [s]

  /// [s]
  double now();
  /// Whether ROS time had stopped at the last call of now().
  bool stands() const { return stands_; }

 private:
  ros::Time last_;
  ros::SteadyTime since_;  ///< when ROS time last changed
  bool stands_ = false;
};

}  // namespace helix_arm::ros_bridge
