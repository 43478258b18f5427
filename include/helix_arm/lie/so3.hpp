#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>

namespace helix_arm::lie {

/// Rotation of space, as a unit quaternion. R_AB turns vectors seen in B into A.
struct SO3 {
  Eigen::Quaterniond quaternion = Eigen::Quaterniond::Identity();

  SO3 operator*(const SO3& R_BC) const { return {quaternion * R_BC.quaternion}; }
  SO3 inverse() const { return {quaternion.conjugate()}; }
  /// The same with a quaternion of unit length, against the rounding of many products.
  SO3 normalized() const { return {quaternion.normalized()}; }

  /// exp of the rotation vector w [rad]: the rotation by |w| about w. Its
  /// error grows with |w|: 4 eps up to a half turn, 8 eps up to two turns.
  static SO3 exp(const Eigen::Vector3d& w);

  /// The rotation vector w [rad] with |w| <= pi whose exp is this rotation, whichever of its two
  /// quaternions it has. At exactly pi either sign of w is an answer.
  Eigen::Vector3d log() const;
};

}  // namespace helix_arm::lie
