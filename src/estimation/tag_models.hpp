#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <cmath>

#include "helix_arm/estimation/twist_fit.hpp"
#include "helix_arm/lie/se3.hpp"

/// Residuals of tags against a shape, and their derivatives with respect to motions of the arm's
/// parts.
namespace helix_arm::estimation {

/// Residuals of one tag, in expected standard deviations. A small rigid motion [v; w] of the tag,
/// seen from the nominal base B0 and about its origin, changes them by by_v v + by_w w; the bleed
/// changes them by by_bleed.
template <int kRows>
struct TagRows {
  static constexpr int kCount = kRows;
  Eigen::Matrix<double, kRows, 1> residual;
  Eigen::Matrix<double, kRows, 3> by_v, by_w;
  Eigen::Matrix<double, kRows, 1> by_bleed;
};

struct CornerModel {
  using Observation = CornerObservation;
  using Rows = TagRows<8>;
  static constexpr bool kBleeds = true;

  lie::SE3 X_CB0;  // nominal base seen from the camera
  double weight;   // focal length / noise
  const TwistFitOptions& options;

  int residuals() const { return 8; }
  // RMS of the corners' distances along one axis [px].
  double shown(const Observation&, const lie::SE3&, double square) const {
    return options.corner_noise * std::sqrt(square / residuals());
  }

  // False if a corner is behind the camera.
  bool evaluate(const Observation& seen, const lie::SE3& X_B0T, const Corners& plane,
                Rows& rows) const {
    const Eigen::Matrix3d& R = X_B0T.rotation;
    for (int c = 0; c < 4; ++c) {
      const Eigen::Vector3d arm = R.col(0) * plane(0, c) + R.col(1) * plane(1, c);
      const Eigen::Vector3d p = arm + X_B0T.translation;
      const Eigen::Vector3d p_C = X_CB0 * p;
      if (!(p_C.z() > 0)) return false;
      const double per_z = 1.0 / p_C.z(), scale = weight * per_z;
      // Towards the centre of the tag, along both of its axes.
      const Eigen::Vector3d inward =
          R.col(0) * (plane(0, c) > 0 ? -1.0 : 1.0) + R.col(1) * (plane(1, c) > 0 ? -1.0 : 1.0);
      for (int axis = 0; axis < 2; ++axis) {
        const int row = 2 * c + axis;
        const double direction = p_C[axis] * per_z;
        const Eigen::Vector3d n =
            scale * (X_CB0.rotation.row(axis) - direction * X_CB0.rotation.row(2)).transpose();
        rows.residual[row] = weight * (direction - seen.direction(axis, c));
        rows.by_v.row(row) = n.transpose();
        rows.by_w.row(row) = p.cross(n).transpose();
        rows.by_bleed[row] = n.dot(inward);
      }
    }
    return true;
  }
};

struct PoseModel {
  using Observation = PoseObservation;
  using Rows = TagRows<6>;
  static constexpr bool kBleeds = false;

  const TwistFitOptions& options;

  int residuals() const { return options.rotation_noise > 0 ? 6 : 3; }
  // Distance of the positions [m].
  double shown(const Observation& seen, const lie::SE3& X_B0T, double) const {
    return (X_B0T.translation - seen.X_BT.translation).norm();
  }

  bool evaluate(const Observation& seen, const lie::SE3& X_B0T, const Corners&, Rows& rows) const {
    const double weight = 1.0 / options.position_noise;
    const Eigen::Matrix3d& R = X_B0T.rotation;
    rows.residual.setZero();
    rows.by_v.setZero();
    rows.by_w.setZero();
    rows.residual.head<3>() = weight * (X_B0T.translation - seen.X_BT.translation);
    rows.by_v.topRows<3>().setIdentity();
    rows.by_v *= weight;
    rows.by_w.topRows<3>() = -weight * lie::skew(X_B0T.translation);
    if (options.rotation_noise > 0) {
      const lie::SE3 turn{seen.X_BT.rotation.transpose() * R, Eigen::Vector3d::Zero()};
      const lie::Vector6 phi = turn.log();
      rows.residual.tail<3>() = phi.tail<3>() / options.rotation_noise;
      rows.by_w.bottomRows<3>() = lie::SE3::rightJacobianInverse(phi).bottomRightCorner<3, 3>() *
                                  R.transpose() / options.rotation_noise;
    }
    return true;
  }
};

/// Motion of a part of the arm due to a change of a twist, about the origin of B0 and seen from B0:
/// v = v_by_v dv + v_by_w dw, w = v_by_v dw.
struct Mover {
  Eigen::Matrix3d v_by_v, v_by_w;

  static Mover none() { return {Eigen::Matrix3d::Zero(), Eigen::Matrix3d::Zero()}; }
  // Motion of all parts beyond s on a piece that starts at X_B0k.
  Mover(const lie::SE3& X_B0k, const lie::Vector6& twist, double s) {
    const lie::Matrix6 J = lie::SE3::leftJacobian(s * twist);
    v_by_v = s * X_B0k.rotation * J.topLeftCorner<3, 3>();
    v_by_w = s * X_B0k.rotation * J.topRightCorner<3, 3>();
    v_by_w += lie::skew(X_B0k.translation) * v_by_v;
  }
  // Motion of the whole arm with the base.
  explicit Mover(const lie::SE3& X_B0B)
      : v_by_v(X_B0B.rotation), v_by_w(lie::skew(X_B0B.translation) * X_B0B.rotation) {}

  // Sum over several pieces that change together.
  Mover& operator+=(const Mover& other) {
    v_by_v += other.v_by_v;
    v_by_w += other.v_by_w;
    return *this;
  }
  Mover& operator*=(double share) {
    v_by_v *= share;
    v_by_w *= share;
    return *this;
  }

  template <class Rows, class Jacobian>
  void fill(const Rows& rows, int column, Jacobian& J) const {
    J.template middleCols<3>(column).noalias() = rows.by_v.lazyProduct(v_by_v);
    J.template middleCols<3>(column + 3).noalias() = rows.by_v.lazyProduct(v_by_w);
    J.template middleCols<3>(column + 3).noalias() += rows.by_w.lazyProduct(v_by_v);
  }

 private:
  Mover(const Eigen::Matrix3d& by_v, const Eigen::Matrix3d& by_w) : v_by_v(by_v), v_by_w(by_w) {}
};

inline bool isFinite(const CornerObservation& seen) { return seen.direction.allFinite(); }
inline bool isFinite(const PoseObservation& seen) {
  return seen.X_BT.translation.allFinite() && seen.X_BT.rotation.allFinite();
}

}  // namespace helix_arm::estimation
