#pragma once

#include <cstdint>

#include <ros/time.h>

namespace helix_arm::ros_bridge {

/// Exact difference of any two stamps [s]; that of ros::Time throws if they are far apart.
inline double secondsBetween(const ros::Time& from, const ros::Time& to) {
  return 1e-9 * static_cast<double>(static_cast<std::int64_t>(to.toNSec()) -
                                    static_cast<std::int64_t>(from.toNSec()));
}

/// Whether ROS can compute with a time: it is below 2^31 s, with less than 10^9 ns.
inline bool isSound(const ros::Time& time) {
  constexpr std::uint32_t kEndOfTime = 1U << 31U;  // [s]
  constexpr std::uint32_t kNanosecondsASecond = 1000000000;
  return time.sec < kEndOfTime && time.nsec < kNanosecondsASecond;
}

/// ROS time while it advances. If it stops, for example because the node that simulates it has
/// ended, a steady clock continues it, so that earlier data still ages.
///
/// Call now() more often than every kPatience.
class MovingClock {
 public:
  static constexpr double kPatience = 2.0;  ///< longest stop of ROS time [s]

  /// [s]
  double now() {
    const ros::Time time = ros::Time::now();
    const ros::SteadyTime steady = ros::SteadyTime::now();
    if (time != last_ || since_.isZero()) since_ = steady;
    last_ = time;
    const double still = (steady - since_).toSec();
    stands_ = still > kPatience;
    return stands_ ? time.toSec() + still : time.toSec();
  }
  /// Whether ROS time had stopped at the last call of now().
  bool stands() const { return stands_; }

 private:
  ros::Time last_;
  ros::SteadyTime since_;  ///< when ROS time last changed
  bool stands_ = false;
};

}  // namespace helix_arm::ros_bridge
