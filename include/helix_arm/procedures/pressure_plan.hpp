#pragma once

#include <Eigen/Core>
#include <vector>

#include "helix_arm/control/target_check.hpp"
#include "helix_arm/model/arm.hpp"

namespace helix_arm::procedures {

/// The pressures (12 x actuators) [Pa] that the paper calibrates at: 0, 10, 15, 20 .. 60 psi of
/// 60 psi, as shares of each actuator's own range. Level j is on actuator j mod n, the others are
/// at their lower limits.
Eigen::MatrixXd defaultPressurePlan(const model::Arm& arm);

/// The plan (steps x actuators) [Pa] of a row-by-row list; empty: the default one.
///
/// A list that is no multiple of the actuators, or holds pressures outside the limits or no two
/// that differ, is refused.
control::Checked<Eigen::MatrixXd> checkPlan(const model::Arm& arm, const std::vector<double>& rows);

}  // namespace helix_arm::procedures
