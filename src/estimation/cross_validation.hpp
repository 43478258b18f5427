#pragma once

#include <Eigen/Core>
#include <optional>
#include <vector>

#include "calibration_checks.hpp"
#include "calibration_problem.hpp"

/// How a calibration predicts captures that it has not seen.
namespace helix_arm::estimation {

struct CrossValidation {
  HeldOut by_pressure;
  std::optional<HeldOut> by_arm;      ///< where there are several
  std::vector<model::Twists> shapes;  ///< (captures) by the fit without their pressure
  bool complete = true;               ///< all fits without a pressure converged
  Eigen::VectorXd variance;  ///< (parameters) by the jackknife over pressures, in their own units
};

/// Refits without each pressure, and each arm, in turn.
///
/// @param problem    with shapes of the model; its values are the full solution, and are restored.
/// @param in_sample  all readings at that solution.
CrossValidation crossValidate(const std::vector<ArmCaptures>& arms, const Groups& groups,
                              ReadingKind kind, CalibrationProblem& problem, double noise_scale,
                              const std::vector<Comparison>& in_sample);

}  // namespace helix_arm::estimation
