#pragma once

#include "helix_arm/lie/se2.hpp"
#include "helix_arm/lie/se3.hpp"

namespace helix_arm::lie {

/// Derivative of Jr(xi)^-1 eta, solveRightJacobian(), with respect to xi. For |w| < 2 pi.
Matrix6 solvedRightJacobianSlope(const Vector6& xi, const Vector6& eta);
SE2::Matrix solvedRightJacobianSlope(const SE2::Tangent& xi, const SE2::Tangent& eta);

}  // namespace helix_arm::lie
