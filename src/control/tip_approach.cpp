#include "helix_arm/control/tip_approach.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>

#include "helix_arm/basics/requirement.hpp"
#include "tip_rules.hpp"

namespace helix_arm::control {
namespace {

constexpr double kPeakRate = 15.0 / 8.0;  // 30 s^2 - 60 s^3 + 30 s^4 at s = 1/2

lie::SO3 rotationOf(const lie::SE3& X_BT, const char* whose) {
  requireRotation(X_BT.rotation, "tip approach: ", whose);
  return {Eigen::Quaterniond(X_BT.rotation).normalized()};
}

}  // namespace

TipApproach::TipApproach(const Eigen::Vector3d& from, const Eigen::Vector3d& to, double most_speed)
    : from_(from), to_(to) {
  requireWithinReach(from, "position", "m", "tip approach: from");
  requireWithinReach(to, "position", "m", "tip approach: to");
  setDuration((to - from).norm(), most_speed);
}

TipApproach::TipApproach(const lie::SE3& from, const lie::SE3& to, double most_speed)
    : TipApproach(from.translation, to.translation, most_speed) {
  R_BT_ = rotationOf(from, "from");
  turn_ = (R_BT_->inverse() * rotationOf(to, "to")).log();
  const double weight = statics::InverseOptions().rotation_weight;
  setDuration(std::max((to_ - from_).norm(), weight * turn_.norm()), most_speed);
}

void TipApproach::setDuration(double length, double most_speed) {
  constexpr char kCulprit[] = "tip approach";
  basics::requireValue(std::isfinite(most_speed) && most_speed > 0, kCulprit, "most_speed",
                       most_speed, "a finite value > 0 [m/s]");
  duration_ = kPeakRate * length / most_speed;
  basics::require(duration_ <= kLongestPath, kCulprit, ": takes ", duration_, " s over ", length,
                  " m at a most_speed of ", most_speed, " m/s; expected at most ", kLongestPath,
                  " s: give a larger most_speed");
}

TipReference TipApproach::at(double time) const noexcept {
  const bool inside = time > 0 && time < duration_;
  double covered = time >= duration_ ? 1.0 : 0.0, rate = 0.0;
  if (inside) {
    const double s = time / duration_;
    covered = s * s * s * (10.0 + s * (6.0 * s - 15.0));
    rate = 30.0 * s * s * (1.0 - s) * (1.0 - s) / duration_;
  }
  TipReference reference;
  reference.position = covered < 1.0 ? Eigen::Vector3d(from_ + covered * (to_ - from_)) : to_;
  reference.velocity = rate * (to_ - from_);
  if (R_BT_) {
    const lie::SO3 R_BT = (*R_BT_ * lie::SO3::exp(covered * turn_)).normalized();
    reference.rotation = R_BT.quaternion.toRotationMatrix();
    reference.angular_velocity = rate * (R_BT_->quaternion * turn_);
  }
  return reference;
}

}  // namespace helix_arm::control
