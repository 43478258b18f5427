#pragma once

#include <optional>
#include <string>
#include <vector>

#include "helix_arm/procedures/calibration_job.hpp"

/// The response of actuators in a calibration.
namespace helix_arm::procedures {

/// Fits the response to free lengths or to a series of the tip, whichever the data hold, into
/// outcome.response; with warnings on what the data do not determine or show to be absent.
///
/// @param names  curves that get it, at least one; what the data do not determine stays as that of
/// the first one. @return cause and remedy if it cannot be fitted.
std::optional<std::string> fitResponseOf(const io::Scene& scene, const CalibrationRequest& request,
                                         const CalibrationData& data,
                                         const std::vector<std::string>& names,
                                         CalibrationOutcome& outcome);

}  // namespace helix_arm::procedures
