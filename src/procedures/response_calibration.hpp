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

/// Captures with effective pressures in place of the measured ones, as far as
/// a series was recorded through them.
struct EffectiveCaptures {
  std::vector<estimation::Capture> captures;
  std::vector<int> unknown;  ///< numbers of those that keep their measured pressures
};
/// @param arm  with the responses. Without any, nothing changes.
EffectiveCaptures effectiveCaptures(const model::Arm& arm, const ResponseSeries& tips,
                                    std::vector<estimation::Capture> captures);

}  // namespace helix_arm::procedures
