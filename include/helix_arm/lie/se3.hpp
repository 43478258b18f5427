#pragma once

#include <Eigen/Core>

/// Rigid motions in space. Twists are [v; w], v first, as in the paper; v in m and w in rad over
/// the whole section.
namespace helix_arm::lie {

using Vector6 = Eigen::Matrix<double, 6, 1>;  ///< a twist
using Matrix6 = Eigen::Matrix<double, 6, 6>;  ///< acts on twists

/// Cross-product matrix: skew(w) u = w x u.
Eigen::Matrix3d skew(const Eigen::Vector3d& w);

/// A pose X_AB: frame B seen from frame A; x_A = rotation * x_B + translation.
///
/// A plain value: it does not store its frames and does not renormalise. The caller keeps the
/// rotation orthogonal.
struct SE3 {
  static constexpr int kDof = 6;
  static constexpr int kSpace = 3;
  static constexpr int kRotations = 3;  ///< the last kRotations entries of a twist are angles
  using Tangent = Vector6;
  using Matrix = Matrix6;
  using Point = Eigen::Vector3d;

  Eigen::Matrix3d rotation = Eigen::Matrix3d::Identity();
  Eigen::Vector3d translation = Eigen::Vector3d::Zero();  ///< [m]

  SE3 operator*(const SE3& X_BC) const {
    return {rotation * X_BC.rotation, rotation * X_BC.translation + translation};
  }
  Point operator*(const Point& p_B) const { return rotation * p_B + translation; }
  SE3 inverse() const;

  /// exp of the twist xi = [v; w]: the pose after motion with xi for unit time. |w| up to 1e5 rad.
  static SE3 exp(const Tangent& xi);

  /// The twist [v; w] with |w| <= pi whose exp is this pose. At exactly pi the sign of w is
  /// arbitrary.
  Tangent log() const;

  /// Ad_X, which transforms a twist seen in B to A: xi_A = Ad_X xi_B.
  Matrix adjoint() const;

  /// Left Jacobian: exp(xi + d) = exp(Jl d) exp(xi) to first order. The right Jacobian is Jr(xi) =
  /// Jl(-xi).
  static Matrix leftJacobian(const Tangent& xi);
  static Matrix rightJacobian(const Tangent& xi) { return leftJacobian(-xi); }

  /// Inverse Jacobians; singular where |w| = 2 pi k, k > 0.
  static Matrix leftJacobianInverse(const Tangent& xi);
  static Matrix rightJacobianInverse(const Tangent& xi) { return leftJacobianInverse(-xi); }
  /// Jr(xi)^-1 eta, without forming the matrix.
  static Tangent solveRightJacobian(const Tangent& xi, const Tangent& eta);

  /// d translation(exp(xi)) / d xi (3 x 6), in the frame that exp(xi) is seen from.
  static Eigen::Matrix<double, 3, 6> translationJacobian(const Tangent& xi);
};

}  // namespace helix_arm::lie
