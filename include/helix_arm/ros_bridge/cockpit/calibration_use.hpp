#pragma once

#include <string>
#include <vector>

#include "helix_arm/RunCalibrationResult.h"
#include "helix_arm/ros_bridge/cockpit/call_desk.hpp"

namespace helix_arm::ros_bridge {

/// One line per parameter that the data determined: name, value before and after, standard error.
std::vector<std::string> parameterLines(const RunCalibrationResult& result);

/// Writes the last calibration of an arm's calibration node into its ~out_folder, under a name that
/// holds the time, and loads it in pressure_command, vision, sight_loop and calibration, those that
/// are up. Blocks.
///
/// @param ns  resolved namespace of the arm's nodes.
CallAnswer useLastCalibration(const std::string& ns);

}  // namespace helix_arm::ros_bridge
