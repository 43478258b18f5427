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

/// The same pressures actuator by actuator, ascending in each.
Eigen::MatrixXd risingPressurePlan(const model::Arm& arm);

/// The steps of a plan and then the same in reverse; the last one is not repeated.
Eigen::MatrixXd thereAndBack(const Eigen::MatrixXd& plan);

/// The plan (steps x actuators) [Pa] from a row-by-row list; the default plan if it is empty. With
/// `loop` there and back, by default that of risingPressurePlan(), so that each pressure is reached
/// from below and from above.
///
/// A list is refused if its size is not a multiple of the number of actuators, a pressure is
/// outside the limits, or no two pressures differ.
control::Checked<Eigen::MatrixXd> checkPlan(const model::Arm& arm, const std::vector<double>& rows,
                                            bool loop = false);

}  // namespace helix_arm::procedures
