#pragma once

#include <optional>

#include "helix_arm/estimation/calibration.hpp"
#include "helix_arm/io/scene.hpp"

/// K_kappa by the paper's definition, in addition to a calibration.
namespace helix_arm::procedures {

/// See CalibrationOutcome::least_tip_error.
///
/// @param data  captures of the arm, as used by the calibration.
/// @param options  of the calibration.
/// @return nothing if K_kappa or its tips do not follow from the calibration.
std::optional<estimation::LeastTipError> leastTipError(
    const io::Scene& scene, const estimation::ArmCaptures& data,
    const estimation::Calibration& calibration, const estimation::CalibrationOptions& options);

}  // namespace helix_arm::procedures
