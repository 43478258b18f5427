#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include <diagnostic_msgs/DiagnosticStatus.h>
#include <ros/time.h>

#include "helix_arm/io/scene.hpp"
#include "ros_bridge/pressure/pressure_loop.hpp"

namespace helix_arm::ros_bridge {

/// The statuses `<node>: safety`, `<node>: regulator`, if it is the node's own, and `<node>:
/// channel <actuator>` for each actuator; pressures in kPa, as their keys say.
std::vector<diagnostic_msgs::DiagnosticStatus> pressureStatuses(const std::string& node,
                                                                const io::Scene& scene,
                                                                const PressureLoop::Snapshot& path);

/// The rate of a pressure loop between two calls.
class LoopRate {
 public:
  /// @param wanted  [Hz]
  explicit LoopRate(double wanted) : wanted_(wanted), last_look_(ros::SteadyTime::now()) {}

  /// The status `<node>: loop`: WARN if the loop was slower than wanted since the last call.
  /// @param now  when the snapshot was taken.
  diagnostic_msgs::DiagnosticStatus status(const std::string& node,
                                           const PressureLoop::Snapshot& path,
                                           const ros::SteadyTime& now);

 private:
  const double wanted_;
  std::uint64_t turns_ = 0;  ///< turns of the loop at the last call
  ros::SteadyTime last_look_;
};

}  // namespace helix_arm::ros_bridge
