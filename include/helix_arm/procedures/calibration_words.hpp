#pragma once

#include <cstddef>
#include <string>
#include <vector>

#include "helix_arm/procedures/calibration_job.hpp"

namespace helix_arm::procedures {

/// All fitted numbers: those of the calibration, then those of the response.
std::vector<estimation::Parameter> parametersOf(const CalibrationOutcome& outcome);

/// Whether a parameter has a standard error and a verdict: not without CalibrationRequest::errors.
bool isJudged(const estimation::Parameter& parameter);

/// What the data of a calibration determined; without errors, what was fitted.
struct Determined {
  std::vector<estimation::Parameter> parameters;  ///< without those of tags
  std::vector<int> tags;  ///< ids of tags with a parameter that was determined, ascending
  int omitted = 0;        ///< number of parameters that were not determined, those of tags included
};
Determined determinedOf(const CalibrationOutcome& outcome);

/// Value, standard error with two digits, and unit: "K_gamma = 61.7 +- 9.2"; without an error
/// "K_gamma = 61.7231". Pressures in kPa.
std::string textOf(const estimation::Parameter& parameter);

/// Name and relative error: "K_gamma^0.97 K_kappa^0.25 +- 1.2 %", or of 100 % and more
/// "+- a factor of 15".
std::string textOf(const estimation::Combination& combination);

/// What stands for the numbers of a placement: "pose of the base" if it has some, "places of 3
/// tags" if these have some.
std::vector<std::string> placementTexts(bool base, std::size_t tags);

/// Tip error before and after [mm]: "tip error 14.3 mm before, 1.0 mm after"; empty if unknown.
std::string tipErrorText(const CalibrationOutcome& outcome);

/// Result of a calibration that succeeded, in one line: its tip error, then what was determined, or
/// without errors what was fitted.
std::string resultText(const std::string& scene, const CalibrationOutcome& outcome);

}  // namespace helix_arm::procedures
