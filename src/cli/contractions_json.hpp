#pragma once

#include <optional>
#include <string>

#include "helix_arm/procedures/calibration_job.hpp"
#include "output.hpp"

namespace helix_arm::cli {

/// "quintic", "table" or "spline"; nothing of other words.
std::optional<estimation::CurveKind> curveKindOf(const std::string& word);

/// The fitted contraction curves, with their samples and points to draw.
nlohmann::json contractionsJson(const procedures::CalibrationOutcome& outcome,
                                const procedures::CalibrationData& data);

}  // namespace helix_arm::cli
