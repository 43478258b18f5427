#pragma once

#include <ros/time.h>

namespace helix_arm::ros_bridge {

/// ROS time for as long as it goes on; where it stands still, as when the node that simulates it
/// has ended, a steady clock takes over, so that what came before grows old all the same.
///
/// To be asked more often than kPatience.
class MovingClock {
 public:
  static constexpr double kPatience = 2.0;  ///< that ROS time may stand still [s]

  /// [s]
  double now();
  /// Whether ROS time stood still when now() was last called.
  bool stands() const { return stands_; }

 private:
  ros::Time last_;
  ros::SteadyTime since_;  ///< when ROS time became what it is
  bool stands_ = false;
};

}  // namespace helix_arm::ros_bridge
