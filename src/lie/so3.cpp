#include "helix_arm/lie/so3.hpp"

#include <cmath>

namespace helix_arm::lie {
namespace {

// Angle [rad], and norm of a quaternion's vector part, above which exp and log of a rotation divide
// by it. Below, the quotient's limit is exact.
constexpr double kExpSwitch = 1e-8, kLogSwitch = 1e-8;

}  // namespace

SO3 SO3::exp(const Eigen::Vector3d& w) {
  const double angle = w.norm();
  const double sinc = angle > kExpSwitch ? std::sin(0.5 * angle) / angle : 0.5;
  SO3 R;
  R.quaternion.w() = std::cos(0.5 * angle);
  R.quaternion.vec() = sinc * w;
  return R;
}

Eigen::Vector3d SO3::log() const {
  Eigen::Quaterniond q = quaternion;
  if (q.w() < 0) q.coeffs() *= -1.0;
  const double sine = q.vec().norm();
  return (sine > kLogSwitch ? 2.0 * std::atan2(sine, q.w()) / sine : 2.0) * q.vec();
}

Eigen::Vector4d quaternionXyzw(const Eigen::Matrix3d& R) {
  const Eigen::Quaterniond q = Eigen::Quaterniond(R).normalized();
  return q.w() < 0 ? Eigen::Vector4d(-q.coeffs()) : Eigen::Vector4d(q.coeffs());
}

}  // namespace helix_arm::lie
