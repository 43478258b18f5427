#pragma once

#include <Eigen/Core>
#include <vector>

#include "calibration_checks.hpp"
#include "calibration_fit.hpp"

/// Which captures say something of the parameters, and which would say most next: of stiffness and
/// length scales, or, where none are fitted, of all.
namespace helix_arm::estimation {

/// Information that the captures at each pressure add to that of the others.
struct Gains {
  std::vector<double> of;  ///< (groups) [nats]
  double least = 0;        ///< captures that add no more than this say nothing new [nats]
};
/// Of a fit with shapes of the model.
Gains gainsOf(const CalibrationFit& fit, const Groups& groups);

/// Pressures within the arm's limits, best first, each given the ones before it (greedy D-optimal
/// design).
///
/// @param fit  with shapes of the model; the arm is its first one.
/// @return at most `count` of (actuators) [Pa].
std::vector<Eigen::VectorXd> nextPressures(const CalibrationFit& fit, const model::Arm& arm,
                                           int count);

}  // namespace helix_arm::estimation
