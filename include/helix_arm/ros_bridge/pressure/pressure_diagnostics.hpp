#pragma once

#include <string>
#include <vector>

#include <diagnostic_msgs/DiagnosticStatus.h>

#include "helix_arm/io/scene.hpp"
#include "helix_arm/ros_bridge/pressure/pressure_loop.hpp"

namespace helix_arm::ros_bridge {

/// The statuses `<node>: safety`, `<node>: regulator`, where it is the node's own, and
/// `<node>: channel <actuator>` for each actuator; pressures in kPa, as their keys say.
std::vector<diagnostic_msgs::DiagnosticStatus> pressureStatuses(const std::string& node,
                                                                const io::Scene& scene,
                                                                const PressureLoop::Snapshot& path);

}  // namespace helix_arm::ros_bridge
