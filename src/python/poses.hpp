#pragma once

#include <Eigen/Core>

#include "helix_arm/lie/se3.hpp"

namespace helix_arm::python {

/// Unit quaternion (x, y, z, w), w >= 0.
Eigen::Vector4d quaternionXyzw(const Eigen::Matrix3d& rotation);

/// Writes a position (3) [m] and a quaternion (4); NaN unless it was found.
void setPose(const lie::SE3& pose, bool found, double* position, double* quaternion);

}  // namespace helix_arm::python
