#pragma once

#include <string>
#include <vector>

#include "helix_arm/RunCalibrationResult.h"
#include "ros_bridge/cockpit/call_desk.hpp"

namespace helix_arm::ros_bridge {

/// One line per parameter that the data determined: name, value before and after, standard error.
/// As in the result's message, one line stands for the pose of the base and one for all tags.
/// Parameters that began at 0 and are smaller than their standard error share the last line.
std::vector<std::string> parameterLines(const RunCalibrationResult& result);

/// Writes the last calibration of an arm's calibration node into its ~out_folder, under a name that
/// holds the time, and loads it in pressure_command, vision, visual_servo and calibration, those
/// that are up. Blocks.
///
/// @param ns  resolved namespace of the arm's nodes.
CallAnswer useLastCalibration(const std::string& ns);

}  // namespace helix_arm::ros_bridge
