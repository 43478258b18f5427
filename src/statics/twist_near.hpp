#pragma once

#include "helix_arm/lie/se3.hpp"

namespace helix_arm::statics {

/// The twist whose exp is X and whose rotation vector is nearest to `near` [rad], by more than pi
/// if necessary.
lie::Vector6 twistNear(const lie::SE3& X, const Eigen::Vector3d& near);

}  // namespace helix_arm::statics
