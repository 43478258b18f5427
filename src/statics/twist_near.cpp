#include "twist_near.hpp"

#include <Eigen/LU>
#include <cmath>

#include "helix_arm/basics/pi.hpp"
#include "helix_arm/lie/coefficients.hpp"

namespace helix_arm::statics {

lie::Vector6 twistNear(const lie::SE3& X, const Eigen::Vector3d& near) {
  constexpr double kTurn = 2 * basics::kPi;
  const lie::Vector6 xi = X.log();
  const double angle = xi.tail<3>().norm();
  const double along = angle > 0 ? near.dot(xi.tail<3>()) / angle : 0.0;
  const double turns = std::round((along - angle) / kTurn);
  if (turns == 0) return xi;
  const Eigen::Vector3d w = xi.tail<3>() * ((angle + turns * kTurn) / angle);
  const auto f = lie::expCoefficients(w.squaredNorm());
  const Eigen::Matrix3d V =
      f.a * Eigen::Matrix3d::Identity() + f.b * lie::skew(w) + f.c * (w * w.transpose()).eval();
  lie::Vector6 out;
  out << V.fullPivLu().solve(X.translation), w;
  return out;
}

}  // namespace helix_arm::statics
