#pragma once

#include <Eigen/Core>
#include <functional>
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
  /// What was asked for and stays where it was; still a parameter of the problem where nothing else
  /// would be left.
  std::vector<Parameter> held;
};

/// Whether a parameter that is known to this variance counts as identified: see
/// Parameter::identifiable.
bool isIdentified(const ParameterInfo& info, double variance);

/// Fits as many entries of the stiffness as the captures identify, of as many those that they know
/// best; the others are held.
///
/// The fit refers to arms and options.
/// @param holds_up  what else a fit that identifies its stiffness must pass.
CalibrationFit fitIdentified(const std::vector<ArmCaptures>& arms,
                             const CalibrationOptions& options, const Selection& wanted,
                             ReadingKind kind,
                             const std::function<bool(const CalibrationFit&)>& holds_up);

}  // namespace helix_arm::estimation
