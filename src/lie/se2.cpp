#include "helix_arm/lie/se2.hpp"

#include <cmath>

#include "lie/coefficients.hpp"

namespace helix_arm::lie {
namespace {

Eigen::Vector2d quarterTurn(const Eigen::Vector2d& u) { return {-u.y(), u.x()}; }

// scale * I + turn * J, J the quarter turn
Eigen::Matrix2d scaledRotation(double scale, double turn) {
  Eigen::Matrix2d M;
  M << scale, -turn, turn, scale;
  return M;
}

Eigen::Matrix2d inverseOfV(double w) {
  return scaledRotation(1.0 - w * w * logCoefficient(w * w), -0.5 * w);
}

}  // namespace

SE2 SE2::inverse() const { return {rotation.transpose(), -(rotation.transpose() * translation)}; }

SE2 SE2::exp(const Tangent& xi) {
  const double w = xi[2];
  const ExpCoefficients f = expCoefficients(w * w, -detail::squareRemainder(w * w, w));
  SE2 X;
  X.rotation = scaledRotation(f.cosine, f.a * w);
  X.translation = f.a * xi.head<2>() + f.b * w * quarterTurn(xi.head<2>());
  return X;
}

SE2::Tangent SE2::log() const {
  const double w = std::atan2(rotation(1, 0), rotation(0, 0));
  Tangent xi;
  xi << inverseOfV(w) * translation, w;
  return xi;
}

SE2::Matrix SE2::adjoint() const {
  Matrix Ad;
  Ad << rotation, -quarterTurn(translation), 0, 0, 1;
  return Ad;
}

SE2::Matrix SE2::leftJacobian(const Tangent& xi) {
  const Eigen::Vector2d v = xi.head<2>();
  const double w = xi[2];
  const ExpCoefficients f = expCoefficients(w * w);
  Matrix J;
  J << scaledRotation(f.a, f.b * w), w * f.c * v - f.b * quarterTurn(v), 0, 0, 1;
  return J;
}

SE2::Matrix SE2::leftJacobianInverse(const Tangent& xi) {
  const Eigen::Matrix2d V_inverse = inverseOfV(xi[2]);
  Matrix J;
  J << V_inverse, -V_inverse * leftJacobian(xi).topRightCorner<2, 1>(), 0, 0, 1;
  return J;
}

SE2::Tangent SE2::solveRightJacobian(const Tangent& xi, const Tangent& eta) {
  const double w = xi[2];
  const Eigen::Vector2d once = quarterTurn(w * eta.head<2>() - eta[2] * xi.head<2>());
  Tangent out = eta;
  out.head<2>() += 0.5 * once + logCoefficient(w * w) * w * quarterTurn(once);
  return out;
}

SE3 embed(const SE2& X) {
  SE3 out;
  out.rotation.topLeftCorner<2, 2>() = X.rotation;
  out.translation.head<2>() = X.translation;
  return out;
}

Vector6 embed(const SE2::Tangent& xi) {
  Vector6 out;
  out << xi[0], xi[1], 0, 0, 0, xi[2];
  return out;
}

SE2::Tangent project(const Vector6& xi) { return {xi[0], xi[1], xi[5]}; }

}  // namespace helix_arm::lie
