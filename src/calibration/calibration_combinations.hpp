#pragma once

#include <Eigen/Core>
#include <optional>
#include <string>
#include <vector>

#include "calibration_checks.hpp"
#include "calibration_fit.hpp"
#include "calibration_problem.hpp"

/// Prediction of captures that were held out of a calibration.
namespace helix_arm::estimation {

/// Repeats the fit without each pressure, and without each arm, in turn.
///
/// @param problem    uses shapes of the model; its values are the full solution, and are restored.
/// @param in_sample  residuals of all readings at that solution.
CrossValidation crossValidate(const std::vector<ArmCaptures>& arms, const Groups& groups,
                              ReadingKind kind, CalibrationProblem& problem, double noise_scale,
                              const std::vector<Comparison>& in_sample);

// Combinations of stiffness parameters in which the errors of a calibration are uncorrelated.

/// @param reported  values of the parameters, with the names of `fit`.
/// @param left_out  fits without each pressure, of `fit.asked` and of `fit.problem`; empty if there
///     are too few pressures.
std::vector<Combination> combinationsOf(const std::vector<ArmCaptures>& arms,
                                        const CalibrationOptions& options,
                                        const CalibrationFit& fit, ReadingKind kind,
                                        const std::vector<Parameter>& reported,
                                        const std::vector<Jackknife>& left_out);

}  // namespace helix_arm::estimation
