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

/// The plan (steps x actuators) [Pa] from a row-by-row list; the default plan if it is empty.
///
/// A list is refused if its size is not a multiple of the number of actuators, a pressure is
/// outside the limits, or no two pressures differ.
control::Checked<Eigen::MatrixXd> checkPlan(const model::Arm& arm, const std::vector<double>& rows);

}  // namespace helix_arm::procedures
