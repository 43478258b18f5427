#pragma once

#include <optional>
#include <string>

#include "helix_arm/procedures/calibration_job.hpp"
#include "output.hpp"

namespace helix_arm::cli {

/// "quintic", "table" or "spline"; nothing of other words.
std::optional<estimation::CurveKind> curveKindOf(const std::string& word);

/// The fitted contraction curves, with their samples and points to draw.
nlohmann::json contractionsJson(const procedures::CalibrationOutcome& outcome);

/// The fitted response; null if none was asked for.
nlohmann::json responseJson(const std::optional<procedures::FittedResponse>& found);

}  // namespace helix_arm::cli
