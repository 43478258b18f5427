#pragma once

#include <Eigen/Core>
#include <vector>

#include "calibration_checks.hpp"
#include "calibration_fit.hpp"

/// Information of captures about the parameters, and the most informative next pressures. The
/// parameters are stiffness and length scales or, if none are fitted, all of them.
namespace helix_arm::estimation {

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
