#include "arm_swing.hpp"

#include <algorithm>
#include <cmath>

#include "basics/pi.hpp"

namespace helix_arm::follow {
namespace {

// Error of the lag in a picture, in standard errors. It persists.
constexpr double kLagError = 4.0;
// Changes of frequency and damping from which on a found mode is another one, as logarithms.
constexpr double kOtherFrequency = 0.02, kOtherDamping = 0.2;

}  // namespace

ArmSwing::ArmSwing(const model::Arm& arm, const VisualServoConfig& config, bool known,
                   const std::vector<int>& rows)
    : told_(config.mode),
      usual_smoothing_(config.smoothing),
      time_constant_(config.time_constant),
      sections_(arm.sectionCount()),
      response_(arm, known, config.mode),
      peak_(Eigen::VectorXd::Zero(arm.actuatorCount())),
      mode_(config.mode),
      smoothing_(config.smoothing) {
  for (std::size_t i = 0; i < rows.size(); ++i) {
    if (estimation::bends(rows[i])) bends_.push_back(static_cast<int>(i));
  }
}

void ArmSwing::moveTo(double stamp, const estimation::ResponseEstimator::Pressures& pressures) {
  const double before = swung_at_;
  swung_at_ = stamp;
  response_.moveTo(stamp, pressures);
  const double left = mode_ ? std::exp(std::min(before - stamp, 0.0) * 2 * basics::kPi *
                                       mode_->frequency * mode_->damping)
                            : 0.0;
  peak_ = (left * peak_).cwiseMax(response_.swing().cwiseAbs());
}

void ArmSwing::learn(const model::Twists& measured, const estimation::ArmFilter& tracker,
                     bool moved) {
  const auto& step = tracker.lastStep();
  const Eigen::VectorXd unit = tracker.biasDeviation()(bends_).cwiseInverse();
  const Eigen::VectorXd picked = measured.reshaped()(tracker.rows())(bends_);
  if (moved) response_.skip();
  response_.compare(unit.cwiseProduct(picked),
                    unit.asDiagonal() * step->model.by_lengths(bends_, Eigen::all));
  const auto found = response_.mode();
  if (!found) return;
  const bool changed = !mode_ ||
                       std::abs(std::log(found->frequency / mode_->frequency)) > kOtherFrequency ||
                       std::abs(std::log(found->damping / mode_->damping)) > kOtherDamping;
  if (!changed) return;
  mode_ = found;
  smoothing_ =
      std::max(usual_smoothing_, smoothingFor(mode_->frequency, mode_->damping, time_constant_));
}

void ArmSwing::reset() {
  response_.reset();
  peak_.setZero();
  mode_ = told_;
  smoothing_ = usual_smoothing_;
}

model::Twists ArmSwing::atRest(const model::Twists& measured,
                               const estimation::ArmFilter& tracker) const {
  model::Twists out = measured;
  const auto& step = tracker.lastStep();
  if (!step) return out;
  const Eigen::VectorXd swings = step->model.by_lengths * response_.swing();
  for (const int i : bends_) {
    out.reshaped()[tracker.rows()[static_cast<std::size_t>(i)]] -= swings[i];
  }
  return out;
}

Eigen::VectorXd ArmSwing::peak(const estimation::ArmFilter& tracker) const {
  return mode_ ? rowsOf(peak_, tracker) : rowsOf({}, tracker);
}

Eigen::VectorXd ArmSwing::possible(const estimation::ArmFilter& tracker) const {
  return mode_ ? rowsOf({}, tracker) : rowsOf(response_.possibleSwing(), tracker);
}

// Most that lengths which swing by as much (n) [m], if any, add to each row.
Eigen::VectorXd ArmSwing::rowsOf(const Eigen::VectorXd& swing,
                                 const estimation::ArmFilter& tracker) const {
  Eigen::VectorXd out = Eigen::VectorXd::Zero(static_cast<Eigen::Index>(tracker.rows().size()));
  const auto& step = tracker.lastStep();
  if (swing.size() == 0 || !step) return out;
  out(bends_) = step->model.by_lengths(bends_, Eigen::all).cwiseAbs() * swing;
  return out;
}

Eigen::MatrixXd ArmSwing::noise(double part, const estimation::ArmFilter& tracker) const {
  Eigen::MatrixXd out = Eigen::MatrixXd::Zero(6 * sections_, 6 * sections_);
  const auto& step = tracker.lastStep();
  if (!mode_ || !step) return out;
  Eigen::MatrixXd by_peak = Eigen::MatrixXd::Zero(step->model.by_lengths.rows(), peak_.size());
  by_peak(bends_, Eigen::all) =
      part * step->model.by_lengths(bends_, Eigen::all) * peak_.asDiagonal();
  out(tracker.rows(), tracker.rows()) = by_peak * by_peak.transpose();
  return out;
}

double ArmSwing::lagDoubt() const { return kLagError * response_.lag().deviation; }

Eigen::MatrixXd ArmSwing::lagNoise(const estimation::ArmFilter& tracker) const {
  Eigen::MatrixXd out = Eigen::MatrixXd::Zero(6 * sections_, 6 * sections_);
  const auto& step = tracker.lastStep();
  if (!step) return out;
  const Eigen::VectorXd by_lag = kLagError * step->model.by_lengths * response_.lagError();
  out(tracker.rows(), tracker.rows()) = by_lag * by_lag.transpose();
  return out;
}

}  // namespace helix_arm::follow
