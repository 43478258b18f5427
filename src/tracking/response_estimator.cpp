#include "helix_arm/tracking/response_estimator.hpp"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>

#include "helix_arm/basics/pi.hpp"

namespace helix_arm::estimation {
namespace {

constexpr double kMostLag = 1.0;       // [s]
constexpr double kLargestPlay = 2e4;   // [Pa]
constexpr double kHighestMode = 10.0;  // [Hz]
// Standard deviations at the start, and what they grow by in a minute: of factors, lag [s], play
// [Pa], and logarithms of frequency and damping.
constexpr double kFactorPrior = 0.2, kFactorCreep = 0.02;
constexpr std::array<double, 4> kResponsePrior = {0.15, 5e3, 0.1, 0.5},
                                kResponseCreep = {0.01, 1e3, 0.02, 0.2};
// Of an arm that shows no mode, what is quicker than its lag, and by how much it may differ.
constexpr Mode kQuick = {6.0, 0.2};
constexpr std::array<double, 2> kQuickPrior = {0.5, 0.2};
constexpr double kResponseMemory = 2.0;  // of the high-pass filter: play stays seen [s]
constexpr std::array<double, 4> kResponseStep = {0.01, 500, 0.01, 0.05};  // of differences
// Residuals: their size at the start and at least in expected errors, in how many seconds of motion
// it is averaged, and for how many pictures they persist.
constexpr double kFirstResidual = 0.7, kLeastResidual = 0.02, kResidualTime = 2.0;
constexpr double kResidualPersistence = 10.0;
constexpr double kOtherMode = 0.2;  // of the frequency's logarithm
// What was compared with modes behind a lag this far from the estimate misleads [s].
constexpr double kOtherLag = 0.03;

}  // namespace

ResponseEstimator::ResponseEstimator(const model::Arm& arm, bool known,
                                     const std::optional<Mode>& told)
    : arm_(arm), known_(known), told_(told), gains_(arm.actuatorCount()), modes_(arm) {
  swing_.setZero(gains_);
  reset();
}

void ResponseEstimator::reset() {
  modes_.reset();
  time_.reset();
  compared_.reset();
  state_.setZero(gains_ + kParameters);
  state_.head(gains_).setOnes();
  covariance_.setZero(state_.size(), state_.size());
  covariance_.diagonal().head(gains_).setConstant(kFactorPrior * kFactorPrior);
  for (int i = 0; i < 2 && !known_; ++i) {
    covariance_(gains_ + i, gains_ + i) = kResponsePrior[i] * kResponsePrior[i];
  }
  variance_ = kFirstResidual * kFirstResidual;
  modes_lag_ = 0.0;
  found_ = swings_ = false;
  swing_.setZero();
  if (!known_) begin(kQuick, kQuickPrior[0], kQuickPrior[1]);
  found_ = told_.has_value();
  if (told_) begin(*told_, kResponsePrior[2], kResponsePrior[3]);
  setChains();
}

void ResponseEstimator::begin(const Mode& mode, double frequency_prior, double damping_prior) {
  swings_ = true;
  covariance_.bottomRows<2>().setZero();
  covariance_.rightCols<2>().setZero();
  covariance_.diagonal().tail<2>() << frequency_prior * frequency_prior,
      damping_prior * damping_prior;
  state_.tail<2>() << std::log(mode.frequency), std::log(mode.damping);
}

Estimated ResponseEstimator::play() const {
  return {state_[gains_ + 1], std::sqrt(covariance_(gains_ + 1, gains_ + 1))};
}

Eigen::VectorXd ResponseEstimator::lagError() const {
  return lag().deviation / kResponseStep[0] * (chains_[1].lengths - chains_[0].lengths);
}

std::optional<Mode> ResponseEstimator::mode() const { return found_ ? bending() : std::nullopt; }

std::optional<Mode> ResponseEstimator::bending() const {
  if (!swings_) return std::nullopt;
  const Eigen::Index f = gains_ + 2, z = gains_ + 3;
  const double frequency = std::exp(state_[f]), damping = std::exp(state_[z]);
  return Mode{frequency, damping, frequency * std::sqrt(covariance_(f, f)),
              damping * std::sqrt(covariance_(z, z))};
}

void ResponseEstimator::setChains() {
  for (int i = 0; i <= kParameters; ++i) {
    Eigen::Vector4d at = state_.tail<kParameters>();
    if (i > 0) at[i - 1] += kResponseStep[i - 1];
    Chain& chain = chains_[i];
    chain.lag = at[0];
    chain.play = at[1];
    chain.turn = swings_ ? 2 * basics::kPi * std::exp(at[2]) : 0.0;
    chain.damping = std::exp(at[3]);
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

void ResponseEstimator::step(const Eigen::VectorXd& pressure, double dt) {
  for (Chain& chain : chains_) {
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
      continue;
    }
    const double paced = dt * paceOf(arm_, chain.goal);
    chain.rate += paced * chain.turn *
                  (chain.turn * (chain.goal - chain.lengths) - 2 * chain.damping * chain.rate);
    chain.lengths += paced * chain.rate;
  }
}

void ResponseEstimator::moveTo(double time, const Pressures& pressures) {
  modes_.moveTo(time, [&](double when) -> const Eigen::VectorXd& {
    if (!time_ || when < *time_ || when - *time_ > kSwingPause) {
      restart(pressures(when));
    } else {
      step(pressures(when), when - *time_);
    }
    time_ = when;
    return chains_[0].goal;
  });
  swing_ = chains_[0].lengths - chains_[0].goal;
}

void ResponseEstimator::compare(const Eigen::VectorXd& measured,
                                const Eigen::MatrixXd& by_lengths) {
  modes_.compare(measured, by_lengths);
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
  if (measured_.squaredNorm() < kLeastMotion * kLeastMotion * count) return;
  learn(by_lengths, dt);
  if (std::abs(state_[gains_] - modes_lag_) > kOtherLag) {
    modes_lag_ = state_[gains_];
    modes_.reset();
  }
  const auto& found = modes_.mode();
  if (found &&
      !(found_ && std::abs(std::log(found->frequency) - state_[gains_ + 2]) < kOtherMode)) {
    begin(*found, kResponsePrior[2], kResponsePrior[3]);
    found_ = true;
  }
  setChains();
}

void ResponseEstimator::learn(const Eigen::MatrixXd& by_lengths, double dt) {
  Eigen::MatrixXd H = Eigen::MatrixXd::Zero(measured_.size(), state_.size());
  const Eigen::VectorXd factors = state_.head(gains_);
  H.leftCols(gains_) = by_lengths * chains_[0].passed.asDiagonal();
  for (int i = 0; i < (swings_ ? kParameters : 2); ++i) {
    H.col(gains_ + i) = by_lengths *
                        factors.cwiseProduct(chains_[i + 1].passed - chains_[0].passed) /
                        kResponseStep[i];
  }
  const Eigen::VectorXd residual = measured_ - H.leftCols(gains_) * factors;
  const double size2 = residual.squaredNorm() / static_cast<double>(residual.size());
  variance_ -= std::expm1(-dt / kResidualTime) * (size2 - variance_);
  variance_ = std::max(variance_, kLeastResidual * kLeastResidual);
  for (Eigen::Index i = 0; i < state_.size(); ++i) {
    const double creep = i < gains_ ? kFactorCreep : kResponseCreep[i - gains_];
    if (covariance_(i, i) > 0) covariance_(i, i) += creep * creep * dt / 60;
  }
  const Eigen::MatrixXd PH = covariance_ * H.transpose();
  Eigen::MatrixXd S = H * PH;
  S.diagonal().array() += kResidualPersistence * variance_;
  const Eigen::MatrixXd gain = S.ldlt().solve(PH.transpose()).transpose();
  state_ += gain * residual;
  covariance_ -= gain * PH.transpose();
  covariance_ = (0.5 * (covariance_ + covariance_.transpose())).eval();
  state_[gains_] = std::clamp(state_[gains_], 0.0, kMostLag);
  state_[gains_ + 1] = std::clamp(state_[gains_ + 1], 0.0, kLargestPlay);
  state_[gains_ + 2] = std::min(state_[gains_ + 2], std::log(kHighestMode));
}

}  // namespace helix_arm::estimation
