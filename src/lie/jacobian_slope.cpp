#include "lie/jacobian_slope.hpp"

#include <Eigen/Geometry>

#include "lie/coefficients.hpp"

namespace helix_arm::lie {

Matrix6 solvedRightJacobianSlope(const Vector6& xi, const Vector6& eta) {
  using Eigen::Matrix3d;
  using Eigen::Vector3d;
  // The terms of SE3::solveRightJacobian(), each with its derivatives.
  const Vector3d v = xi.head<3>(), w = xi.tail<3>();
  const Matrix3d V = skew(v), W = skew(w);
  const Matrix3d N = skew(eta.head<3>()), M = skew(eta.tail<3>());
  const auto [g, slope] = logCoefficientAndSlope(w.squaredNorm());
  const double curvature = logCoefficientCurvature(w.squaredNorm());
  const Vector3d w1 = w.cross(eta.tail<3>());
  const Vector3d v1 = w.cross(eta.head<3>()) + v.cross(eta.tail<3>());
  const Vector3d w2 = w.cross(w1);
  const Vector3d v2 = w.cross(v1) + v.cross(w1);
  const Matrix3d w2_by_w = -skew(w1) - W * M;  // also v2 by v
  const Matrix3d v2_by_w = -skew(v1) - W * N - V * M;
  const double wv = 2.0 * w.dot(v);
  const Matrix3d same = -0.5 * M + g * w2_by_w + 2.0 * slope * w2 * w.transpose();
  Matrix6 out;
  out << same,
      -0.5 * N + g * v2_by_w + slope * wv * w2_by_w + 2.0 * slope * v2 * w.transpose() +
          w2 * (2.0 * curvature * wv * w + 2.0 * slope * v).transpose(),
      Matrix3d::Zero(), same;
  return out;
}

SE2::Matrix solvedRightJacobianSlope(const SE2::Tangent& xi, const SE2::Tangent& eta) {
  const Matrix6 in_space = solvedRightJacobianSlope(embed(xi), embed(eta));
  SE2::Matrix out;
  for (int i = 0; i < 3; ++i) {
    out.col(i) = project(Vector6(in_space * embed(SE2::Tangent(SE2::Tangent::Unit(i)))));
  }
  return out;
}

}  // namespace helix_arm::lie
