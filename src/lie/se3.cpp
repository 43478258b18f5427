#include "helix_arm/lie/se3.hpp"

#include <Eigen/Geometry>
#include <cmath>

#include "lie/coefficients.hpp"

namespace helix_arm::lie {
namespace {

// Unit quaternion (x, y, z, w) of R, w >= 0, from its largest component: accurate near pi, too.
Eigen::Vector4d quaternionOf(const Eigen::Matrix3d& R) {
  const double trace = R.trace();
  Eigen::Vector4d q;
  int i = 0;
  R.diagonal().maxCoeff(&i);
  if (trace >= R(i, i)) {
    const double s = std::sqrt(1.0 + trace);
    q << R(2, 1) - R(1, 2), R(0, 2) - R(2, 0), R(1, 0) - R(0, 1), s * s;
    q *= 0.5 / s;
  } else {
    const int j = (i + 1) % 3, k = (i + 2) % 3;
    const double s = std::sqrt(1.0 + R(i, i) - R(j, j) - R(k, k));
    q[i] = s * s;
    q[j] = R(j, i) + R(i, j);
    q[k] = R(k, i) + R(i, k);
    q[3] = R(k, j) - R(j, k);
    q *= (q[3] < 0 ? -0.5 : 0.5) / s;
  }
  return q;
}

}  // namespace

Eigen::Matrix3d skew(const Eigen::Vector3d& w) {
  Eigen::Matrix3d W;
  W << 0, -w.z(), w.y(), w.z(), 0, -w.x(), -w.y(), w.x(), 0;
  return W;
}

SE3 SE3::inverse() const { return {rotation.transpose(), -(rotation.transpose() * translation)}; }

SE3::Tangent SE3::log() const {
  const Eigen::Vector4d q = quaternionOf(rotation);
  const Eigen::Vector3d u = q.head<3>();
  const double sin_h = u.stableNorm();
  // theta / sin(theta / 2) tends to 2 as the vector part vanishes.
  const double scale = sin_h > 0 ? 2.0 * std::atan2(sin_h, q[3]) / sin_h : 2.0;
  const Eigen::Vector3d w = scale * u;
  const double g = logCoefficient(w.squaredNorm());
  Tangent xi;
  xi << translation - 0.5 * w.cross(translation) + g * w.cross(w.cross(translation)), w;
  return xi;
}

Matrix6 SE3::adjoint() const {
  Matrix6 Ad;
  Ad << rotation, skew(translation) * rotation, Eigen::Matrix3d::Zero(), rotation;
  return Ad;
}

Matrix6 SE3::leftJacobian(const Tangent& xi) {
  // A left step rotates about the origin: the change of p = V v contains w x p.
  const Eigen::Matrix<double, 3, 6> D = translationJacobian(xi);
  const Eigen::Matrix3d V = D.leftCols<3>();
  const Eigen::Vector3d p = V * xi.head<3>();
  Matrix6 J;
  J.topLeftCorner<3, 3>() = V;
  J.bottomRightCorner<3, 3>() = V;
  J.bottomLeftCorner<3, 3>().setZero();
  J.topRightCorner<3, 3>() = D.rightCols<3>();
  for (int i = 0; i < 3; ++i) J.block<3, 1>(0, 3 + i) += p.cross(V.col(i));
  return J;
}

Matrix6 SE3::leftJacobianInverse(const Tangent& xi) {
  const Eigen::Matrix3d W = skew(xi.tail<3>());
  const double g = logCoefficient(xi.tail<3>().squaredNorm());
  const Eigen::Matrix3d V_inverse = Eigen::Matrix3d::Identity() - 0.5 * W + g * W * W;
  const Eigen::Matrix3d Q = leftJacobian(xi).topRightCorner<3, 3>();
  Matrix6 J;
  J << V_inverse, -V_inverse * Q * V_inverse, Eigen::Matrix3d::Zero(), V_inverse;
  return J;
}

SE3::Tangent SE3::solveRightJacobian(const Tangent& xi, const Tangent& eta) {
  // A twist is the dual vector w + e v, e^2 = 0: Jr^-1 = 1 + [xi]/2 + g(|xi|^2) [xi]^2 as in SO(3).
  const Eigen::Vector3d v = xi.head<3>(), w = xi.tail<3>();
  const auto [g, slope] = logCoefficientAndSlope(w.squaredNorm());
  const Eigen::Vector3d w1 = w.cross(eta.tail<3>());
  const Eigen::Vector3d v1 = w.cross(eta.head<3>()) + v.cross(eta.tail<3>());
  const Eigen::Vector3d w2 = w.cross(w1);
  const Eigen::Vector3d v2 = w.cross(v1) + v.cross(w1);
  Tangent out = eta;
  out.head<3>() += 0.5 * v1 + g * v2 + 2.0 * slope * w.dot(v) * w2;
  out.tail<3>() += 0.5 * w1 + g * w2;
  return out;
}

Eigen::Matrix<double, 3, 6> SE3::translationJacobian(const Tangent& xi) {
  const Eigen::Vector3d v = xi.head<3>();
  const Eigen::Vector3d w = xi.tail<3>();
  const auto [a, b, c, d, e] = jacobianCoefficients(w.squaredNorm());
  const double wv = w.dot(v);
  // p = a v + b w x v + c (w.v) w, x = |w|^2: 2 da/dx = c - b, 2 db/dx = 2d - c, 2 dc/dx = 3e - d
  const Eigen::Vector3d dx = (c - b) * v + (2.0 * d - c) * w.cross(v) + (3.0 * e - d) * wv * w;
  Eigen::Matrix<double, 3, 6> J;
  J.leftCols<3>() = c * w * w.transpose() + b * skew(w);
  J.leftCols<3>().diagonal().array() += a;
  J.rightCols<3>() = dx * w.transpose() + c * w * v.transpose() - b * skew(v);
  J.rightCols<3>().diagonal().array() += c * wv;
  return J;
}

}  // namespace helix_arm::lie
