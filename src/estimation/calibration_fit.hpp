#pragma once

#include <Eigen/Core>
#include <functional>
#include <memory>
#include <vector>

#include "calibration_checks.hpp"
#include "calibration_problem.hpp"

/// Fit of those parameters that the captures determine.
namespace helix_arm::estimation {

struct CalibrationFit {
  std::unique_ptr<CalibrationProblem> problem;  ///< at the fitted values
  bool converged = false;
  double noise_scale = 1;  ///< noise as a multiple of the expected noise
  // The sizes are those of the problem's parameters.
  Eigen::MatrixXd information;  ///< from readings and priors
  Eigen::MatrixXd covariance;  ///< includes the prior uncertainty of parameters that are not fitted
  std::vector<bool> identified;
  /// Requested parameters that keep their initial value. They remain parameters of the problem if
  /// no others would be left.
  std::vector<Parameter> held;
};

/// Whether a parameter with this variance counts as identified; see Parameter::identifiable.
bool isIdentified(const ParameterInfo& info, double variance);

/// Fits as many entries of the stiffness as the captures identify. Among sets of equal size, the
/// best-determined entries are fitted. The others keep their values.
///
/// The fit keeps references to arms and options.
/// @param holds_up  additional check that a fit with identified stiffness must pass.
CalibrationFit fitIdentified(const std::vector<ArmCaptures>& arms,
                             const CalibrationOptions& options, const Selection& wanted,
                             ReadingKind kind,
                             const std::function<bool(const CalibrationFit&)>& holds_up);

}  // namespace helix_arm::estimation
