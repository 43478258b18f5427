#pragma once

#include <Eigen/Core>

#include "helix_arm/model/arm.hpp"

namespace helix_arm::procedures {

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
