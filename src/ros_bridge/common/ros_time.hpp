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

}  // namespace helix_arm::ros_bridge
