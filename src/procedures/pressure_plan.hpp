#pragma once

#include <Eigen/Core>
#include <vector>

#include "helix_arm/control/target_check.hpp"
#include "helix_arm/model/arm.hpp"

namespace helix_arm::procedures {

/// The paper's calibration pressures (12 x actuators) [Pa]: 0, 10, 15, 20 .. 60 psi of 60 psi, as
/// shares of each actuator's own range. Level j is on actuator j mod n, the others are at their
/// lower limits.
Eigen::MatrixXd defaultPressurePlan(const model::Arm& arm);

/// The plan (steps x actuators) [Pa] from a row-by-row list; the default plan if it is empty. With
/// `loop` there and back, by default actuator by actuator, so that each pressure is reached from
/// below and from above.
///
/// A list is refused if its size is not a multiple of the number of actuators, a pressure is
/// outside the limits, or no two pressures differ.
control::Checked<Eigen::MatrixXd> checkPlan(const model::Arm& arm, const std::vector<double>& rows,
                                            bool loop = false);

/// Pressures (rows x actuators) [Pa] of a round trip that bends every section in all its
/// directions.
///
/// From rest, once around with each muscle leading in turn, all muscles shortened together, back to
/// rest: a series for playing in a loop. Neighbouring sections lead with different muscles, so that
/// the arm takes S shapes.
/// @param fraction  of each actuator's range that the tour uses, in (0, 1].
/// @throws std::invalid_argument if fraction is outside (0, 1].
Eigen::MatrixXd pressureTour(const model::Arm& arm, double fraction = 0.8);

}  // namespace helix_arm::procedures
