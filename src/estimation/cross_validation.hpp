#pragma once

#include <Eigen/Core>
#include <optional>
#include <vector>

#include "calibration_checks.hpp"
#include "calibration_problem.hpp"

/// Prediction of captures that were held out of a calibration.
namespace helix_arm::estimation {

struct CrossValidation {
  HeldOut by_pressure;
  std::optional<HeldOut> by_arm;      ///< if there are several arms
  std::vector<model::Twists> shapes;  ///< (captures) from the fit without their pressure
  bool complete = true;               ///< whether all fits without a pressure converged
  Eigen::VectorXd variance;  ///< (parameters) jackknife over pressures, in the parameters' units
};

/// Repeats the fit without each pressure, and without each arm, in turn.
///
/// @param problem    uses shapes of the model; its values are the full solution, and are restored.
/// @param in_sample  residuals of all readings at that solution.
CrossValidation crossValidate(const std::vector<ArmCaptures>& arms, const Groups& groups,
                              ReadingKind kind, CalibrationProblem& problem, double noise_scale,
                              const std::vector<Comparison>& in_sample);

}  // namespace helix_arm::estimation
