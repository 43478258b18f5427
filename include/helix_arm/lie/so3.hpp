#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>

namespace helix_arm::lie {

/// Rotation in space as a unit quaternion. R_AB transforms vectors seen in B to A.
struct SO3 {
  Eigen::Quaterniond quaternion = Eigen::Quaterniond::Identity();

  SO3 operator*(const SO3& R_BC) const { return {quaternion * R_BC.quaternion}; }
  SO3 inverse() const { return {quaternion.conjugate()}; }
  /// The same rotation with a renormalised quaternion, against rounding errors of many products.
  SO3 normalized() const { return {quaternion.normalized()}; }

  /// exp of the rotation vector w [rad]: the rotation by |w| about w. The error grows with |w|: 4
  /// eps up to a half turn, 8 eps up to two turns.
  static SO3 exp(const Eigen::Vector3d& w);

  /// The rotation vector w [rad] with |w| <= pi whose exp is this rotation; both quaternions of the
  /// rotation give the same w. At exactly pi the sign of w is arbitrary.
  Eigen::Vector3d log() const;
};

/// Unit quaternion (x, y, z, w) of a rotation, w >= 0.
Eigen::Vector4d quaternionXyzw(const Eigen::Matrix3d& R);

}  // namespace helix_arm::lie
