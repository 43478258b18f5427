#pragma once

#include <Eigen/Core>
#include <Eigen/Eigenvalues>
#include <cmath>
#include <optional>
#include <utility>
#include <vector>

#include "helix_arm/follow/visual_servo_config.hpp"
#include "helix_arm/model/curve.hpp"
#include "helix_arm/tracking/arm_filter.hpp"
#include "helix_arm/tracking/onset_hypotheses.hpp"
#include "helix_arm/tracking/tip_compliance.hpp"
#include "response_tracker.hpp"

/// Watches that the loop keeps while it runs.
namespace helix_arm::follow {

// Error of the swing in a picture, relative to its peak. It persists.
inline constexpr double kSwingError = 2.0;

// Pictures with other tags until these are the usual ones.
inline constexpr int kUsual = 15;

// The arm counts as still while the tip is this close to where it settles, swinging included, as at
// 8 mm/s: what moves it later or sooner than the model looks like a force [m].
inline constexpr double kStillTip = 0.0025;

inline double largestDeviation(const Eigen::Matrix3d& covariance) {
  return std::sqrt(
      Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d>(covariance).eigenvalues().maxCoeff());
}

/// Finds loads on the arm, and drifts, from the pictures of a filter that watches it.
class ContactWatch {
 public:
  ContactWatch(const statics::ArmModel& model, const VisualServoConfig& config)
      : arm_(model.arm()),
        placed_(config.placed),
        compliance_(placed_ ? estimation::TipCompliance(model, placed_->view, placed_->fit)
                            : estimation::TipCompliance(model)),
        onsets_(config.contact) {}

  /// Gives the watch a picture. @param tags  indices of the fitted tags; nothing if unknown.
  /// @param settled  as for OnsetHypotheses::see().
  /// @param swing  what the known mode adds at most to each of the watch's rows.
  /// @param possible  likewise one that is not known yet.
  void see(estimation::ArmFilter::Input picture, const std::optional<std::vector<int>>& tags,
           bool settled, const Eigen::VectorXd& swing, const Eigen::VectorXd& possible,
           estimation::ArmFilter& watch) {
    // A picture that is not used, such as a repeated one, says nothing of the tags either.
    if (watch.check(picture) != estimation::ObservationFault::kNone) return;
    if (tags) takeTags(*tags, picture, watch);
    addInertia(swing, picture, watch);
    const estimation::Observation observation = watch.see(picture);
    if (!observation.accepted() && observation.fault != estimation::ObservationFault::kOutlier)
      return;
    compliance_.moveTo(picture.pressure, watch.correction(), tags);
    by_force_ = compliance_.atTip()(watch.rows(), Eigen::all);
    if (distrusts_) return;
    const model::Shape measured = model::shapeOf(arm_, picture.twists);
    const Eigen::Matrix3d tip = estimation::tipCovariance(measured, watch.twistCovariance(0.0));
    const auto tipMotion = [&](const Eigen::VectorXd& moved) {
      model::Twists at_rest = picture.twists;
      at_rest.reshaped()(watch.rows()) -= moved;
      const model::Shape rest = measured.about(at_rest);
      return (model::tipPose(measured).translation - model::tipPose(rest).translation).norm();
    };
    const double motion =
        std::hypot(tipMotion(watch.lastStep()->swing.cwiseAbs()), tipMotion(swing + possible)) /
        kStillTip;
    onsets_.see(picture.time, largestDeviation(tip), measured, settled, motion, watch, compliance_);
  }

  /// Forgets the pictures.
  void reset() {
    onsets_.reset();
    usual_tags_.reset();
    unusual_ = 0;
  }

  /// Whether loads are not looked for, nor drifts. @return whether that is new.
  bool distrust(bool distrusts) { return std::exchange(distrusts_, distrusts) != distrusts; }
  estimation::OnsetHypotheses& onsets() { return onsets_; }
  const estimation::ExternalLoad& load() const { return onsets_.load(); }
  const estimation::Drift& drift() const { return onsets_.drift(); }

 private:
  // The inertia of a swing shears and stretches the arm as a force at its tip that bends it so.
  void addInertia(const Eigen::VectorXd& swing, estimation::ArmFilter::Input& picture,
                  const estimation::ArmFilter& watch) {
    if (swing.isZero(0) || by_force_.size() == 0) return;
    inertia_ = by_force_;
    double bend2 = 0.0;  // of 1 N across the arm, on average
    for (Eigen::Index i = 0; i < inertia_.rows(); ++i) {
      if (!estimation::bends(watch.rows()[static_cast<std::size_t>(i)])) continue;
      bend2 += inertia_.row(i).squaredNorm() / 2;
      inertia_.row(i).setZero();
    }
    if (bend2 == 0) return;
    inertia_ *= kSwingError * swing.norm() / std::sqrt(bend2);
    inertia_noise_.noalias() = inertia_ * inertia_.transpose();
    picture.covariance(watch.rows(), watch.rows()) += inertia_noise_;
  }

  // Other tags have other placement errors; otherwise, occlusion would look like contact. Tags at
  // the edge of sight come and go: until others stay, what they err differently is an error of
  // single pictures, which persists until then. It must not add to the bias at each change.
  void takeTags(const std::vector<int>& tags, estimation::ArmFilter::Input& picture,
                estimation::ArmFilter& watch) {
    if (!usual_tags_) usual_tags_ = tags;
    unusual_ = tags == *usual_tags_ ? 0 : unusual_ + 1;
    if (unusual_ == 0 || !placed_) return;
    const auto shape = watch.shape(picture.pressure);
    if (!shape) return;
    const auto difference =
        estimation::placementDifference(*placed_, arm_, *shape, *usual_tags_, tags);
    if (!difference) return;
    if (unusual_ < kUsual) {
      picture.covariance += kUsual * *difference;
      return;
    }
    onsets_.growBias((*difference)(watch.rows(), watch.rows()), watch);
    usual_tags_ = tags;
    unusual_ = 0;
  }

  const model::Arm arm_;
  const std::optional<estimation::PlacedView> placed_;
  estimation::TipCompliance compliance_;
  estimation::OnsetHypotheses onsets_;
  Eigen::MatrixXd by_force_;  // (d x 3) change of the watch's rows with a force at the tip [1/N]
  Eigen::MatrixXd inertia_, inertia_noise_;  // (d x 3) [1], (d x d)
  // The tags whose error by placements is part of the watch's bias.
  std::optional<std::vector<int>> usual_tags_;
  int unusual_ = 0;  // pictures in a row with others
  bool distrusts_ = false;
};

/// Detects an arm that moves away from a constant target, and goes on while the loop corrects it:
/// the model bends in the wrong direction. The error is averaged: an arm may swing about a target.
class DivergenceWatch {
 public:
  /// @param correction  time constant with which the loop corrects an error [s].
  explicit DivergenceWatch(double correction) : patience_(correction + 2 * kAveraged) {}

  void clear() {
    errors_.clear();
    suspicion_.reset();
    mean_.reset();
  }

  /// @param offset  of the measured tip from the target [m]. @param corrected  whether the loop
  ///     corrects it, at a constant target within the model's reach.
  /// @return whether the arm diverges.
  bool add(double now, const Eigen::Vector3d& offset, bool corrected) {
    if (!mean_) mean_ = {now, offset};
    mean_->second -= std::expm1((mean_->first - now) / kAveraged) * (offset - mean_->second);
    mean_->first = now;
    const double error = mean_->second.norm();
    errors_.add(now, error);
    const double* const earlier = errors_.find(now - kDoublingTime);
    const bool grows = earlier && error > kDiverged && error > 2 * *earlier;
    if (!corrected) {
      suspicion_.reset();
    } else if (!suspicion_) {
      if (grows) suspicion_ = Suspicion{now, error};
    } else if (error < kCorrectedPart * suspicion_->error) {
      suspicion_.reset();
    } else {
      return now - suspicion_->since >= patience_;
    }
    return false;
  }

 private:
  static constexpr double kDiverged = 0.02;     // [m]
  static constexpr double kDoublingTime = 1.0;  // within which the error doubles [s]
  static constexpr double kAveraged = 0.7;  // time constant of the mean; of 1.5 Hz 15 % stay [s]
  // An error that a load causes at once shrinks to this part while the loop corrects it.
  static constexpr double kCorrectedPart = 0.75;
  static constexpr int kMostErrors = 512;  // of pictures

  // A divergence, unless the error shrinks.
  struct Suspicion {
    double since, error;  // [s], [m]
  };

  double patience_;
  TimeRing<double, kMostErrors> errors_;
  std::optional<std::pair<double, Eigen::Vector3d>> mean_;  // at the last time [s]
  std::optional<Suspicion> suspicion_;
};

}  // namespace helix_arm::follow
