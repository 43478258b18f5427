#include "helix_arm/tracking/response_estimator.hpp"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>

#include "basics/pi.hpp"

namespace helix_arm::estimation {
namespace {

constexpr double kMostLag = 1.0, kMostDead = 0.3;         // [s]
constexpr double kLargestPlay = 2e4;                      // [Pa]
constexpr double kLowestMode = 0.2, kHighestMode = 10.0;  // [Hz]
// Damping. With more, the steps of a fast mode that shortens would not decay.
constexpr double kLeastDamping = 0.005, kMostDamping = 0.9;
// Standard deviations at the start, and what they grow by in a minute: of factors, lag [s], play
// [Pa], dead time [s], and logarithms of frequency and damping.
constexpr double kFactorPrior = 0.2, kFactorCreep = 0.02;
constexpr std::array<double, 5> kResponsePrior = {0.15, 5e3, 0.03, 0.1, 0.5},
                                kResponseCreep = {0.01, 1e3, 0.005, 0.02, 0.2};
constexpr double kResponseMemory = 2.0;  // of the high-pass filter: play stays seen [s]
constexpr std::array<double, 5> kResponseStep = {0.01, 500, 0.01, 0.01, 0.05};  // of differences
// Residuals: their size at the start and at least in expected errors, in how many seconds of motion
// it is averaged, and for how many pictures they persist.
constexpr double kFirstResidual = 0.1, kLeastResidual = 0.02, kResidualTime = 2.0;
constexpr double kResidualPersistence = 10.0;
constexpr double kOtherMode = 0.2;  // of the frequency's logarithm
// A residual this many times the motion of the model is not kept by the high-pass filter.
constexpr double kOtherMotion = 2.0;

}  // namespace

ResponseEstimator::ResponseEstimator(const model::Arm& arm, bool known,
                                     const std::optional<Mode>& told)
    : arm_(arm), known_(known), told_(told), gains_(arm.actuatorCount()), modes_(arm, known) {
  swing_.setZero(gains_);
  reset();
}

void ResponseEstimator::reset() {
  modes_.reset();
  time_.reset();
  compared_.reset();
  state_.setZero(gains_ + kParameters);
  state_.head(gains_).setOnes();
  setPrior();
  variance_ = kFirstResidual * kFirstResidual;
  swings_ = false;
  swing_.setZero();
  if (told_) begin(*told_);
  setChains();
}

void ResponseEstimator::setPrior() {
  covariance_.setZero(state_.size(), state_.size());
  covariance_.diagonal().head(gains_).setConstant(kFactorPrior * kFactorPrior);
  for (int i = known_ ? 3 : 0; i < (swings_ ? kParameters : 3); ++i) {
    covariance_(gains_ + i, gains_ + i) = kResponsePrior[i] * kResponsePrior[i];
  }
}

// Everything that was learnt without the mode, or with another one, is no more than a start.
void ResponseEstimator::begin(const Mode& mode) {
  swings_ = true;
  begun_ = std::log(mode.frequency);
  state_.tail<2>() << std::log(mode.frequency), std::log(mode.damping);
  setPrior();
}

Estimated ResponseEstimator::lag() const {
  const Eigen::Index T = gains_, D = gains_ + 2;
  const double variance = covariance_(T, T) + 2 * covariance_(T, D) + covariance_(D, D);
  return {state_[T] + state_[D], std::sqrt(std::max(0.0, variance))};
}

// Rounding may leave less than 0.
double ResponseEstimator::deviation(Eigen::Index i) const {
  return std::sqrt(std::max(0.0, covariance_(i, i)));
}

Estimated ResponseEstimator::play() const { return {state_[gains_ + 1], deviation(gains_ + 1)}; }

Eigen::VectorXd ResponseEstimator::lagError() const {
  return lag().deviation / kResponseStep[0] * (chains_[1].lengths - chains_[0].lengths);
}

std::optional<Mode> ResponseEstimator::mode() const {
  if (!swings_) return std::nullopt;
  const Eigen::Index f = gains_ + 3, z = gains_ + 4;
  const double frequency = std::exp(state_[f]), damping = std::exp(state_[z]);
  return Mode{frequency, damping, frequency * deviation(f), damping * deviation(z)};
}

void ResponseEstimator::setChains() {
  for (int i = 0; i <= kParameters; ++i) {
    Eigen::Matrix<double, kParameters, 1> at = state_.tail<kParameters>();
    if (i > 0) at[i - 1] += kResponseStep[i - 1];
    Chain& chain = chains_[i];
    chain.lag = at[0];
    chain.play = at[1];
    chain.dead = at[2];
    chain.turn = swings_ ? 2 * basics::kPi * std::exp(at[3]) : 0.0;
    chain.damping = std::exp(at[4]);
  }
}

void ResponseEstimator::restart(const Eigen::VectorXd& pressure) {
  for (Chain& chain : chains_) {
    chain.lagged = chain.played = pressure;
    chain.goal = chain.lengths = arm_.lengths(arm_.clamped(pressure));
    chain.rate.setZero(gains_);
  }
  compared_.reset();
}

void ResponseEstimator::step(Chain& chain, const Eigen::VectorXd& pressure, double dt) const {
  const double share = chain.lag > 0 ? -std::expm1(-dt / chain.lag) : 1.0;
  chain.lagged += share * (pressure - chain.lagged);
  for (Eigen::Index j = 0; j < gains_; ++j) {
    const model::Actuator& actuator = arm_.actuator(static_cast<int>(j));
    chain.played[j] =
        std::clamp(chain.played[j], chain.lagged[j] - chain.play, chain.lagged[j] + chain.play);
    chain.goal[j] = actuator.contraction.lengthInside(
        std::clamp(chain.played[j], actuator.limits.lower, actuator.limits.upper));
  }
  if (chain.turn == 0) {
    chain.lengths = chain.goal;
    return;
  }
  const double paced = dt * paceOf(arm_, chain.goal);
  chain.rate += paced * chain.turn *
                (chain.turn * (chain.goal - chain.lengths) - 2 * chain.damping * chain.rate);
  chain.lengths += paced * chain.rate;
}

void ResponseEstimator::moveTo(double time, const Pressures& pressures) {
  modes_.moveTo(time, pressures);
  // The pressures of that time and of its dead time are remembered for as long.
  if (!time_ || time < *time_ || time - *time_ > kSwingPause - kMostDead) {
    restart(pressures(time - deadTime()));
  } else {
    const int steps = static_cast<int>(std::ceil((time - *time_) / kSwingStep));
    const double dt = (time - *time_) / std::max(steps, 1);
    for (int i = 1; i <= steps; ++i) {
      for (Chain& chain : chains_) step(chain, pressures(*time_ + i * dt - chain.dead), dt);
    }
  }
  time_ = time;
  swing_ = chains_[0].lengths - chains_[0].goal;
}

void ResponseEstimator::compare(const Eigen::VectorXd& measured,
                                const Eigen::MatrixXd& by_lengths) {
  modes_.compare(measured, by_lengths);
  begun_anew_.reset();
  if (!compared_) {
    compared_ = time_;
    for (Chain& chain : chains_) {
      chain.last = chain.lengths;
      chain.passed.setZero(gains_);
    }
    last_measured_ = measured;
    measured_.setZero(measured.size());
    return;
  }
  const double dt = *time_ - *compared_, kept = std::exp(-dt / kResponseMemory);
  compared_ = time_;
  measured_ = kept * (measured_ + measured - last_measured_);
  last_measured_ = measured;
  for (Chain& chain : chains_) {
    chain.passed = kept * (chain.passed + chain.lengths - chain.last);
    chain.last = chain.lengths;
  }
  const auto count = static_cast<double>(measured.size());
  const Eigen::VectorXd motion = by_lengths * chains_[0].passed;
  if (motion.squaredNorm() < kLeastMotion * kLeastMotion * count) return;
  learn(by_lengths, dt);
  if (!state_.allFinite()) return reset();
  const auto& found = modes_.mode();
  if (found) {
    const double frequency = std::log(found->frequency);
    const auto isOther = [&](double than) { return std::abs(frequency - than) >= kOtherMode; };
    // One that pictures have refined away from what was found stays.
    if (!swings_ || (isOther(state_[gains_ + 3]) && isOther(begun_))) begin(*found);
  }
  // Derivatives hold near by alone.
  if (const auto late = known_ ? std::nullopt : modes_.otherLag(lag().value, told_)) {
    beginAnew(*late);
  }
  setChains();
}

void ResponseEstimator::beginAnew(const ModeEstimator::Late& late) {
  const Eigen::Index T = gains_;
  state_[T] = std::max(0.0, late.lag - deadTime());
  covariance_.row(T).setZero();
  covariance_.col(T).setZero();
  covariance_(T, T) = late.deviation * late.deviation;
  variance_ = kFirstResidual * kFirstResidual;
  restart(late.lagged);
  begun_anew_ = late.lagged;
}

void ResponseEstimator::learn(const Eigen::MatrixXd& by_lengths, double dt) {
  Eigen::MatrixXd H = Eigen::MatrixXd::Zero(measured_.size(), state_.size());
  const Eigen::VectorXd factors = state_.head(gains_);
  H.leftCols(gains_) = by_lengths * chains_[0].passed.asDiagonal();
  for (int i = 0; i < (swings_ ? kParameters : 3); ++i) {
    H.col(gains_ + i) = by_lengths *
                        factors.cwiseProduct(chains_[i + 1].passed - chains_[0].passed) /
                        kResponseStep[i];
  }
  const Eigen::VectorXd residual = measured_ - H.leftCols(gains_) * factors;
  // More than the whole motion of the model is not late: something else moves the arm.
  const double moved2 = (H.leftCols(gains_) * factors).squaredNorm();
  if (residual.squaredNorm() > kOtherMotion * kOtherMotion * moved2) skip();
  if (residual.squaredNorm() > moved2) return;
  const double size2 = residual.squaredNorm() / static_cast<double>(residual.size());
  variance_ -= std::expm1(-dt / kResidualTime) * (size2 - variance_);
  variance_ = std::max(variance_, kLeastResidual * kLeastResidual);
  for (Eigen::Index i = 0; i < state_.size(); ++i) {
    const double creep = i < gains_ ? kFactorCreep : kResponseCreep[i - gains_];
    if (covariance_(i, i) > 0) covariance_(i, i) += creep * creep * dt / 60;
  }
  const Eigen::MatrixXd PH = covariance_ * H.transpose();
  Eigen::MatrixXd S = H * PH;
  // A residual beyond the usual ones is of something else.
  S.diagonal().array() += kResidualPersistence * std::max(variance_, size2);
  const Eigen::MatrixXd gain = S.ldlt().solve(PH.transpose()).transpose();
  state_ += gain * residual;
  covariance_ -= gain * PH.transpose();
  covariance_ = (0.5 * (covariance_ + covariance_.transpose())).eval();
  state_[gains_] = std::clamp(state_[gains_], 0.0, kMostLag);
  state_[gains_ + 1] = std::clamp(state_[gains_ + 1], 0.0, kLargestPlay);
  state_[gains_ + 2] = std::clamp(state_[gains_ + 2], 0.0, kMostDead);
  state_[gains_ + 3] =
      std::clamp(state_[gains_ + 3], std::log(kLowestMode), std::log(kHighestMode));
  state_[gains_ + 4] =
      std::clamp(state_[gains_ + 4], std::log(kLeastDamping), std::log(kMostDamping));
}

}  // namespace helix_arm::estimation
