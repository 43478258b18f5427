#pragma once

#include <Eigen/Core>

#include "helix_arm/lie/se3.hpp"

namespace helix_arm::lie {

/// A pose X_AB of the plane: frame B seen from frame A. Twists are [v_x, v_y, w] in [m, m, rad].
struct SE2 {
  static constexpr int kDof = 3;
  static constexpr int kSpace = 2;
  static constexpr int kRotations = 1;
  using Tangent = Eigen::Vector3d;
  using Matrix = Eigen::Matrix3d;
  using Point = Eigen::Vector2d;

  Eigen::Matrix2d rotation = Eigen::Matrix2d::Identity();
  Eigen::Vector2d translation = Eigen::Vector2d::Zero();  ///< [m]

  SE2 operator*(const SE2& X_BC) const {
    return {rotation * X_BC.rotation, rotation * X_BC.translation + translation};
  }
  Point operator*(const Point& p_B) const { return rotation * p_B + translation; }
  SE2 inverse() const;

  static SE2 exp(const Tangent& xi);
  /// The twist with |w| <= pi whose exp is this pose.
  Tangent log() const;
  Matrix adjoint() const;
  static Matrix leftJacobian(const Tangent& xi);
  static Matrix rightJacobian(const Tangent& xi) { return leftJacobian(-xi); }
  static Matrix leftJacobianInverse(const Tangent& xi);
  static Matrix rightJacobianInverse(const Tangent& xi) { return leftJacobianInverse(-xi); }
  /// Jr(xi)^-1 eta, without forming the matrix.
  static Tangent solveRightJacobian(const Tangent& xi, const Tangent& eta);
};

/// Conversions between the plane and the plane z = 0 of space. project() drops the components out
/// of the plane.
SE3 embed(const SE2& X);
Vector6 embed(const SE2::Tangent& xi);    ///< the same of a twist
SE2::Tangent project(const Vector6& xi);  ///< its part in the plane

/// A pose or twist of either group as a spatial one.
inline const SE3& inSpace(const SE3& X) { return X; }
inline SE3 inSpace(const SE2& X) { return embed(X); }                       ///< embedded
inline const Vector6& inSpace(const Vector6& twist) { return twist; }       ///< as it is
inline Vector6 inSpace(const SE2::Tangent& twist) { return embed(twist); }  ///< embedded

}  // namespace helix_arm::lie
