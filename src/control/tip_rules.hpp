#pragma once

#include <Eigen/Core>
#include <Eigen/LU>
#include <cmath>

#include "helix_arm/basics/requirement.hpp"
#include "helix_arm/statics/inverse.hpp"

namespace helix_arm::control {

/// @param quantity, unit  of the vector, for the message: "position", "m".
/// @param whose           its owner, for the message.
/// @throws std::invalid_argument unless all entries are finite and within statics::kFarthestTarget.
template <class... Whose>
void requireWithinReach(const Eigen::Vector3d& vector, const char* quantity, const char* unit,
                        const Whose&... whose) {
  for (int axis = 0; axis < 3; ++axis) {
    basics::require(std::abs(vector[axis]) <= statics::kFarthestTarget, whose..., " has ",
                    "xyz"[axis], " = ", vector[axis], " ", unit, " in its ", quantity,
                    "; expected a finite value of magnitude at most ", statics::kFarthestTarget,
                    ": give it in ", unit, ", seen from the arm's base");
  }
}

/// @throws std::invalid_argument unless R is orthogonal, within rounding, and right-handed.
template <class... Whose>
void requireRotation(const Eigen::Matrix3d& R, const Whose&... whose) {
  constexpr double kRounding = 1e-6;  // of R R' from the identity
  const double error = (R * R.transpose() - Eigen::Matrix3d::Identity()).cwiseAbs().maxCoeff();
  basics::require(R.allFinite() && error <= kRounding, whose...,
                  " has a rotation R with R R' off the identity by ", error, "; expected at most ",
                  kRounding, ": normalise its quaternion");
  basics::require(R.determinant() > 0, whose...,
                  " has a rotation with determinant -1, a mirror image; expected +1: check the "
                  "order and signs of its axes");
}

}  // namespace helix_arm::control
