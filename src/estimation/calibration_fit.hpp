#pragma once

#include <Eigen/Core>
#include <memory>
#include <vector>

#include "calibration_checks.hpp"
#include "calibration_problem.hpp"

/// The fit of those parameters that the captures determine.
namespace helix_arm::estimation {

struct CalibrationFit {
  std::unique_ptr<CalibrationProblem> problem;  ///< at the fitted values
  bool converged = false;
  double noise_scale = 1;  ///< of the expected noise
  // (parameters of the problem)
  Eigen::MatrixXd information;  ///< of readings and priors
  Eigen::MatrixXd covariance;   ///< with what is not known of all that is not fitted
  std::vector<bool> identified;
  /// What was asked for and stays where it was; still a parameter of the problem where it is the
  /// only one.
  std::vector<Parameter> held;
};

/// Holds, one after the other, entries of the stiffness that the captures do not identify.
///
/// The fit refers to arms and options.
CalibrationFit fitIdentified(const std::vector<ArmCaptures>& arms,
                             const CalibrationOptions& options, const Selection& wanted,
                             ReadingKind kind);

/// Sets the values of a problem with as many of each.
void setValues(CalibrationProblem& problem, const Values& values);

}  // namespace helix_arm::estimation
