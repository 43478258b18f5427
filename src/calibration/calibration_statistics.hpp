#pragma once

#include <Eigen/Core>
#include <vector>

#include "calibration_checks.hpp"
#include "calibration_fit.hpp"
#include "calibration_problem.hpp"

/// Statistics of the fit: the noise from residuals, the information from readings and priors.
namespace helix_arm::estimation {

/// Information of readings and priors about the parameters except those of shapes, marginalised
/// over the shapes.
struct Statistics {
  Eigen::MatrixXd information, covariance;  ///< (parameters x parameters)
  /// Whether the information is positive definite; otherwise the covariance is NaN, and so is the
  /// information of free shapes.
  bool determined = true;
};
Statistics statisticsOf(CalibrationProblem& problem, double noise_scale);

/// Joint estimate of parameters and noise.
struct Estimate {
  bool converged = false;
  bool determined = true;   ///< as of Statistics; if it is not, it did not converge
  double noise_scale = 1;   ///< noise as a multiple of the expected noise
  double solved_scale = 1;  ///< the scale used in the last solution, close to noise_scale
  double cost = 0;          ///< of the last solution
  double freedom = 1;       ///< of the noise: residuals in excess of the fitted parameters
};
/// Estimates both together, starting from the problem's values, which are updated.
///
/// @param bias  error that the residuals do not show, in expected standard deviations; >= 0.
Estimate solveWithNoise(CalibrationProblem& problem, double bias);

/// Converts a standard deviation from units of the parameter to units of the value.
double standardErrorOf(const ParameterInfo& info, double value, double deviation);

// Information of captures about the parameters, and the most informative next pressures. The
// parameters are stiffness and length scales or, if none are fitted, all of them.

/// Information that the captures at each pressure add to that of the others.
struct Gains {
  std::vector<double> of;  ///< (groups) [nats]
  double least = 0;        ///< captures with at most this gain add nothing new [nats]
};
/// Requires a fit with shapes of the model.
Gains gainsOf(const CalibrationFit& fit, const Groups& groups);

/// Pressures within the arm's limits, best first, each given the previous ones (greedy D-optimal
/// design).
///
/// @param fit  a fit with shapes of the model.
/// @param arm  the first arm of the fit.
/// @return at most `count` vectors (actuators) [Pa].
std::vector<Eigen::VectorXd> nextPressures(const CalibrationFit& fit, const model::Arm& arm,
                                           int count);

}  // namespace helix_arm::estimation
