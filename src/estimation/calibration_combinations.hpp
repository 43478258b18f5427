#pragma once

#include <Eigen/Core>
#include <optional>
#include <vector>

#include "calibration_fit.hpp"
#include "cross_validation.hpp"

/// Combinations of stiffness parameters in which the errors of a calibration are uncorrelated.
namespace helix_arm::estimation {

/// @param reported  values of the parameters, with the names of `fit`.
/// @param left_out  fits without each pressure, of `fit.asked` and of `fit.problem`; empty if there
///     are too few pressures.
std::vector<Combination> combinationsOf(const std::vector<ArmCaptures>& arms,
                                        const CalibrationOptions& options,
                                        const CalibrationFit& fit, ReadingKind kind,
                                        const std::vector<Parameter>& reported,
                                        const std::vector<Jackknife>& left_out);

}  // namespace helix_arm::estimation
