#include "helix_arm/tracking/mode_estimator.hpp"

#include <algorithm>
#include <array>
#include <cmath>

#include "basics/pi.hpp"

namespace helix_arm::estimation {
namespace {

constexpr std::array<double, 10> kLags = {0.0, 0.03, 0.06, 0.1,  0.15,
                                          0.2, 0.27, 0.35, 0.45, 0.6};  // [s]
constexpr std::array<double, 5> kDampings = {0.02, 0.04, 0.08, 0.16, 0.32};
// Damping of the modes that may be there unseen: what they add dies out within two periods. With
// less, they would hide contacts for many seconds.
constexpr Eigen::Index kUnseenDamping = 3;             // its place in these
constexpr double kLowest = 0.5, kFrequencyStep = 1.1;  // [Hz]
constexpr int kFrequencies = 28;                       // up to 6.6 Hz

constexpr double kHighPass = 0.7;  // time constant [s]
constexpr double kMemory = 15.0;   // of the comparison [s]
// A mode counts if it leaves this part of the residual without one, or with the strongest damping.
constexpr double kClear = 0.5;
// Another lag counts, up to kEarly, once the logarithm of the ratio of residuals times the time of
// comparison is this large, as a likelihood ratio grows with the number of errors [s].
constexpr double kLagEvidence = 0.7;
constexpr double kEarly = 3.0;  // [s]
constexpr double kLeastPictures = 20.0;
constexpr double kDirections = 2.0;  // of the motion that are independent

// Least value of a parabola through three values at -1, 0 and 1: its place, within half a step, and
// the standard error of the place, if the values are sums of squares of `count` errors.
struct Vertex {
  double place = 0.0, deviation = 1.0;
};
Vertex vertexOf(double before, double here, double after, double count) {
  const double curvature = before - 2 * here + after, slope = (after - before) / 2;
  if (!(curvature > 0)) return {};
  const double least = std::max(here - slope * slope / (2 * curvature), 0.1 * here);
  return {std::clamp(-slope / curvature, -0.5, 0.5), std::sqrt(2 * least / (count * curvature))};
}

}  // namespace

double paceOf(const model::Arm& arm, const Eigen::Ref<const Eigen::VectorXd>& lengths) {
  double rest = 0.0;
  for (int i = 0; i < arm.actuatorCount(); ++i) rest += arm.actuator(i).contraction.restLength();
  return rest / lengths.sum();
}

ModeEstimator::ModeEstimator(const model::Arm& arm, bool lag_is_known) : arm_(arm) {
  const int lags = lag_is_known ? 1 : static_cast<int>(kLags.size());
  const int modes = kFrequencies * static_cast<int>(kDampings.size());
  lags_ = Eigen::Map<const Eigen::ArrayXd>(kLags.data(), lags);
  const Eigen::Index count = lags * (modes + 1);
  turn_.setZero(count);
  damping_.setZero(count);
  // Order for each lag: all frequencies of the first damping, of the next one, ..; then no mode.
  for (Eigen::Index k = 0; k < count; ++k) {
    const Eigen::Index mode = k % (modes + 1);
    if (mode == modes) continue;
    turn_[k] = 2 * basics::kPi * kLowest *
               std::pow(kFrequencyStep, static_cast<double>(mode % kFrequencies));
    damping_[k] = kDampings[static_cast<std::size_t>(mode / kFrequencies)];
  }
  const Eigen::Index actuators = arm.actuatorCount();
  lagged_.resize(actuators, lags);
  goal_ = lagged_;
  for (Eigen::MatrixXd* state : {&x_, &v_, &last_x_, &passed_}) state->setZero(count, actuators);
  beyond_.setZero(lags * kFrequencies, actuators);
  possible_.setZero(actuators);
  reset();
}

void ModeEstimator::reset() {
  weight_ = compared_for_ = 0.0;
  time_.reset();
  compared_.reset();
  mode_.reset();
  residual_.setZero(turn_.size());
}

void ModeEstimator::restart(const Eigen::VectorXd& pressure) {
  lagged_.colwise() = pressure.array();
  step(pressure, 0.0);
  const Eigen::Index modes = turn_.size() / lags_.size();
  for (Eigen::Index i = 0; i < lags_.size(); ++i) {
    x_.middleRows(i * modes, modes).rowwise() = goal_.col(i).matrix().transpose();
  }
  v_.setZero();
  beyond_.setZero();
  possible_.setZero();
  compared_.reset();
}

void ModeEstimator::step(const Eigen::VectorXd& pressure, double dt) {
  for (Eigen::Index i = 0; i < lags_.size(); ++i) {
    const double share = lags_[i] > 0 ? -std::expm1(-dt / lags_[i]) : 1.0;
    lagged_.col(i) += share * (pressure.array() - lagged_.col(i));
    for (int j = 0; j < arm_.actuatorCount(); ++j) {
      const model::Actuator& actuator = arm_.actuator(j);
      goal_(j, i) = actuator.contraction.lengthInside(
          std::clamp(lagged_(j, i), actuator.limits.lower, actuator.limits.upper));
    }
  }
  const Eigen::Index modes = turn_.size() / lags_.size();
  for (Eigen::Index i = 0; i < lags_.size(); ++i) {
    // All modes behind this lag; the last one is none.
    const auto turn = turn_.segment(i * modes, modes), damping = damping_.segment(i * modes, modes);
    const double paced = dt * paceOf(arm_, goal_.col(i).matrix());
    for (Eigen::Index j = 0; j < goal_.rows(); ++j) {
      auto x = x_.col(j).segment(i * modes, modes).array();
      auto v = v_.col(j).segment(i * modes, modes).array();
      v += paced * turn * (turn * (goal_(j, i) - x) - 2 * damping * v);
      x += paced * v;
      x[modes - 1] = goal_(j, i);
    }
  }
}

void ModeEstimator::moveTo(double time, const Pressures& pressures) {
  if (!time_ || time < *time_ || time - *time_ > kSwingPause) {
    restart(pressures(time));
  } else {
    const int steps = static_cast<int>(std::ceil((time - *time_) / kSwingStep));
    const double dt = (time - *time_) / std::max(steps, 1);
    for (int i = 1; i <= steps; ++i) step(pressures(*time_ + i * dt), dt);
    if (steps > 0) findPossible(time - *time_);
  }
  time_ = time;
}

// The swing is known by its rate: at a constant one the lengths stay behind their goal. A mode is
// refuted as one is found: another hypothesis leaves a clearly smaller part of the residual.
void ModeEstimator::findPossible(double dt) {
  const Eigen::Index modes = turn_.size() / lags_.size();
  const double most = residual_.minCoeff() / kClear;
  possible_.setZero();
  for (Eigen::Index i = 0; i < lags_.size(); ++i) {
    const Eigen::Index damped = i * modes + kUnseenDamping * kFrequencies;
    const auto turn = turn_.segment(damped, kFrequencies);
    const auto residual = residual_.segment(damped, kFrequencies);
    for (Eigen::Index j = 0; j < goal_.rows(); ++j) {
      auto before = beyond_.col(j).segment(i * kFrequencies, kFrequencies).array();
      const Eigen::ArrayXd beyond = x_.col(j).segment(damped, kFrequencies).array() - goal_(j, i);
      const Eigen::ArrayXd swing = (beyond - before).abs() / (dt * turn);
      possible_[j] = std::max(possible_[j], (residual <= most).select(swing, 0.0).maxCoeff());
      before = beyond;
    }
  }
}

void ModeEstimator::compare(const Eigen::VectorXd& measured, const Eigen::MatrixXd& by_lengths) {
  if (weight_ == 0) {
    cross_.setZero(turn_.size(), measured.size());
    power_ = cross_;
    energy_.setZero(measured.size());
  }
  if (!compared_) {
    compared_ = time_;
    last_x_ = x_;
    passed_.setZero();
    last_measured_ = measured;
    measured_.setZero(measured.size());
    weight_ = std::max(weight_, 1.0);
    return;
  }
  const double dt = *time_ - *compared_;
  compared_ = time_;
  const double kept = std::exp(-dt / kHighPass), share = std::exp(-dt / kMemory);
  measured_ = kept * (measured_ + measured - last_measured_);
  // Rest tells nothing.
  const double least = kLeastMotion * kLeastMotion * static_cast<double>(measured_.size());
  if (measured_.squaredNorm() >= least) compared_for_ += dt;
  last_measured_ = measured;
  passed_ = kept * (passed_ + x_ - last_x_);
  last_x_ = x_;
  energy_ = share * energy_ + measured_.array().square();
  weight_ = share * weight_ + 1.0;
  output_ = (passed_ * by_lengths.transpose()).array();
  cross_ = share * cross_ + output_.rowwise() * measured_.array().transpose();
  power_ = share * power_ + output_.square();
  choose();
}

void ModeEstimator::judge() {
  residual_.setConstant(turn_.size(), energy_.sum());
  for (Eigen::Index i = 0; i < energy_.size(); ++i) {
    const auto cross = cross_.col(i), power = power_.col(i);
    residual_ -= (cross > 0 && power > 0).select(cross.square() / power, 0.0);
  }
  residual_ = residual_.max(0.0);
}

// Place of the hypothesis of a mode among those of a lag.
Eigen::Index ModeEstimator::placeOf(const Mode& mode) const {
  const Eigen::Index none = turn_.size() / lags_.size() - 1;
  const Eigen::ArrayXd turns = turn_.head(none), dampings = damping_.head(none);
  Eigen::Index place = 0;
  ((turns / (2 * basics::kPi * mode.frequency)).log().abs() / std::log(kFrequencyStep) +
   (dampings / mode.damping).log().abs())
      .minCoeff(&place);
  return place;
}

std::optional<ModeEstimator::Late> ModeEstimator::otherLag(double lag,
                                                           const std::optional<Mode>& mode) const {
  if (compared_for_ > kEarly || lags_.size() < 3) return std::nullopt;
  const Eigen::Index modes = turn_.size() / lags_.size();
  const Eigen::Index place = mode ? placeOf(*mode) : 0;
  Eigen::ArrayXd residual(lags_.size());
  for (Eigen::Index i = 0; i < lags_.size(); ++i) {
    const auto of_lag = residual_.segment(i * modes, modes);
    residual[i] = mode ? of_lag[place] : of_lag.minCoeff();
  }
  Eigen::Index best = 0, after = 1;
  const double least = residual.minCoeff(&best);
  if (best == 0 || best == lags_.size() - 1) return std::nullopt;  // it may be beyond
  while (after < lags_.size() - 1 && lags_[after] < lag) ++after;
  const double share = std::min((lag - lags_[after - 1]) / (lags_[after] - lags_[after - 1]), 1.0);
  const double present = residual[after - 1] + share * (residual[after] - residual[after - 1]);
  if (!(compared_for_ * std::log(present / least) >= kLagEvidence)) return std::nullopt;
  // The vertex of a parabola through the three.
  const double left = lags_[best] - lags_[best - 1], right = lags_[best + 1] - lags_[best];
  const double by_left = (least - residual[best - 1]) / left,
               by_right = (residual[best + 1] - least) / right;
  const double vertex =
      lags_[best] - 0.5 * left - 0.5 * by_left * (left + right) / (by_right - by_left);
  const double deviation = 0.3 * (left + right);
  if (!(std::abs(vertex - lag) > deviation)) return std::nullopt;  // the given one, or NaN
  return Late{vertex, deviation, lagged_.col(best)};
}

void ModeEstimator::choose() {
  if (weight_ < kLeastPictures || energy_.sum() < kLeastMotion * kLeastMotion * weight_) return;
  judge();
  const Eigen::Index modes = turn_.size() / lags_.size();
  double without = energy_.sum();
  for (Eigen::Index k = modes - 1; k < turn_.size(); k += modes) {
    without = std::min(without, residual_.segment(k - kFrequencies, kFrequencies + 1).minCoeff());
  }
  Eigen::Index best = 0;
  const double least = residual_.minCoeff(&best);
  // A mode that was found holds until motion shows that there is none.
  if (least >= without) return mode_.reset();
  if (least > kClear * without) return;
  const Eigen::Index place = best % modes;
  const Eigen::Index f = place % kFrequencies, z = place / kFrequencies;
  const auto last_z = static_cast<Eigen::Index>(kDampings.size()) - 1;
  const double count = kDirections * weight_;
  Vertex by_f, by_z;
  if (f > 0 && f < kFrequencies - 1) {
    by_f = vertexOf(residual_[best - 1], least, residual_[best + 1], count);
  }
  if (z > 0 && z < last_z) {
    by_z = vertexOf(residual_[best - kFrequencies], least, residual_[best + kFrequencies], count);
  }
  const auto at = [](Eigen::Index i) { return std::log(kDampings[static_cast<std::size_t>(i)]); };
  const double width = (at(std::min(z + 1, last_z)) - at(std::max<Eigen::Index>(z - 1, 0))) / 2;
  const double frequency = turn_[best] / (2 * basics::kPi) * std::pow(kFrequencyStep, by_f.place);
  const double damping = damping_[best] * std::exp(width * by_z.place);
  mode_ = Mode{frequency, damping, frequency * std::log(kFrequencyStep) * by_f.deviation,
               damping * width * by_z.deviation};
}

}  // namespace helix_arm::estimation
