#include "aim.hpp"

#include <Eigen/Cholesky>
#include <algorithm>
#include <limits>

#include "basics/pi.hpp"
#include "helix_arm/model/curve.hpp"

namespace helix_arm::follow {
namespace {

// Relative to the mean square of the Jacobian's entries: limits the lead near a singular pose.
constexpr double kLeadDamping = 1e-3;
constexpr double kInfinity = std::numeric_limits<double>::infinity();

statics::InverseOptions nearbyWith(statics::Preference preference) {
  statics::InverseOptions out;
  out.preference = preference;
  out.max_starts = 1;
  return out;
}

const statics::InverseResult& solveWith(statics::InverseSolver& solver, const Target& target,
                                        const Eigen::VectorXd& start) {
  if (const auto* position = std::get_if<Eigen::Vector3d>(&target)) {
    return solver.toPosition(*position, start);
  }
  if (const auto* pose = std::get_if<lie::SE3>(&target)) return solver.toPose(*pose, start);
  return solver.toTwists(std::get<model::Twists>(target), start);
}

}  // namespace

Eigen::VectorXd lowestPressures(const model::Arm& arm) {
  return arm.clamped(Eigen::VectorXd::Constant(arm.actuatorCount(), -kInfinity));
}

Eigen::VectorXd highestPressures(const model::Arm& arm) {
  return arm.clamped(Eigen::VectorXd::Constant(arm.actuatorCount(), kInfinity));
}

lie::SE3 tipOf(const Target& target, const model::Arm& arm) {
  if (const auto* position = std::get_if<Eigen::Vector3d>(&target)) {
    return {Eigen::Matrix3d::Identity(), *position};
  }
  if (const auto* pose = std::get_if<lie::SE3>(&target)) return *pose;
  return arm.tipOf(std::get<model::Twists>(target));
}

Aim::Aim(const statics::ArmModel& model, statics::Preference nearby)
    : arm_(model.arm()),
      model_(model),
      everywhere_(model_),
      nearby_(model_, nearbyWith(nearby)),
      corrected_(model_),
      now_(arm_),
      goal_(now_.offset),
      lower_(lowestPressures(arm_)),
      upper_(highestPressures(arm_)),
      pressure_(lower_),
      led_(pressure_),
      lengths_(arm_.actuatorCount()),
      by_lengths_(6, arm_.actuatorCount()),
      by_pressure_(3, arm_.actuatorCount()) {}

const Eigen::VectorXd& Aim::lengthsAt(const Eigen::VectorXd& pressure) {
  for (int i = 0; i < arm_.actuatorCount(); ++i) {
    lengths_[i] = arm_.actuator(i).contraction.lengthInside(pressure[i]);
  }
  return lengths_;
}

void Aim::limit(const Eigen::VectorXd& lower, const Eigen::VectorXd& upper) {
  lower_ = lower;
  upper_ = upper;
  pressure_ = pressure_.cwiseMax(lower_).cwiseMin(upper_);
  everywhere_.limit(lower_, upper_);
  nearby_.limit(lower_, upper_);
}

void Aim::startAt(const Eigen::VectorXd& pressure) {
  pressure_ = pressure.cwiseMax(lower_).cwiseMin(upper_);
}

void Aim::learn(const statics::Correction& goal) {
  const Eigen::VectorXd& lengths = lengthsAt(pressure_);
  const auto before = corrected_.shape(lengths);
  const model::Twists offset = now_.offset;
  now_ = goal;
  now_.offset = offset;
  corrected_.set(now_);
  const auto after = corrected_.shape(lengths);
  if (before && after) now_.offset += before->twists() - after->twists();
  goal_ = goal.offset;
}

void Aim::approach(double share) { now_.offset += share * (goal_ - now_.offset); }

const statics::InverseResult& Aim::solve(const Target& target, bool fresh) {
  corrected_.set(now_);
  statics::InverseSolver& solver = fresh ? everywhere_ : nearby_;
  solver.correct(now_);
  const statics::InverseResult& result = solveWith(solver, target, pressure_);
  if (result.converged()) pressure_ = result.input;
  return result;
}

const Eigen::VectorXd& Aim::led(const Motion& target, double time_constant, const Late& beyond,
                                const std::optional<estimation::Mode>& mode) {
  led_ = pressure_;
  lie::SE3 tip;
  if (target.velocity.isZero() ||
      !corrected_.tipByLengths(lengthsAt(pressure_), tip, by_lengths_)) {
    return led_;
  }
  for (int i = 0; i < arm_.actuatorCount(); ++i) {
    by_pressure_.col(i) = tip.rotation * by_lengths_.col(i).head<3>() *
                          arm_.actuator(i).contraction.slopeInside(pressure_[i]);
  }
  Eigen::Matrix3d square = by_pressure_ * by_pressure_.transpose();
  square.diagonal().array() += kLeadDamping * square.trace() / 3.0;
  const Eigen::LDLT<Eigen::Matrix3d> factors(square);
  const Eigen::Vector3d by_velocity = factors.solve(target.velocity),
                        by_acceleration = factors.solve(target.acceleration);
  // The inverse of regulator, dead time, lag and mode in series, in powers of d/dt.
  const double turn = mode ? 2 * basics::kPi * mode->frequency : 0.0;
  for (int i = 0; i < arm_.actuatorCount(); ++i) {
    const double rate = by_pressure_.col(i).dot(by_velocity);
    const model::Response& response = arm_.actuator(i).response;
    double first = time_constant, second = 0.0;
    const auto behind = [&](double once, double twice) {
      second += first * once + twice;
      first += once;
    };
    behind(beyond.lag + (rate > 0 ? response.rise_time : response.fall_time), 0.0);
    behind(beyond.dead_time, beyond.dead_time * beyond.dead_time / 2);
    if (mode) behind(2 * mode->damping / turn, 1 / turn / turn);
    const double change = first * rate + second * by_pressure_.col(i).dot(by_acceleration);
    led_[i] = std::clamp(pressure_[i] + change, lower_[i], upper_[i]);
  }
  return led_;
}

}  // namespace helix_arm::follow
