#pragma once

#include <Eigen/Core>

#include "calibration_problem.hpp"

/// What residuals say of the noise, and readings and priors of the parameters.
namespace helix_arm::estimation {

/// What readings and priors say of the parameters but those of shapes, whatever the shapes are.
struct Statistics {
  Eigen::MatrixXd information, covariance;  ///< (parameters)^2
  double data_parameters;  ///< of all free parameters, those that the readings determine
};
Statistics statisticsOf(CalibrationProblem& problem, double noise_scale);

/// How a search for parameters and noise ended.
struct Estimate {
  bool converged = false;
  double noise_scale = 1;   ///< of the expected noise
  double solved_scale = 1;  ///< that of the last search, next to it
  double cost = 0;          ///< of the last search
};
/// Solves for both together, from where the problem's values stand, which it moves.
///
/// @param bias  in expected deviations: what residuals do not show; >= 0.
Estimate solveWithNoise(CalibrationProblem& problem, double bias);

/// In the units of the value, from a deviation in those of the parameter.
double standardErrorOf(const ParameterInfo& info, double value, double deviation);

}  // namespace helix_arm::estimation
