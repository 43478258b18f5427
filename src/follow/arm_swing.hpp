#pragma once

#include <Eigen/Core>
#include <optional>
#include <vector>

#include "helix_arm/follow/visual_servo_config.hpp"
#include "helix_arm/tracking/arm_filter.hpp"
#include "helix_arm/tracking/response_estimator.hpp"

namespace helix_arm::follow {

/// The arm's swing about its static shape, in pictures: the estimate of lag, play and mode, and the
/// swing's share of twists and of their errors. Rows are those of the tracker.
class ArmSwing {
 public:
  /// @param known  the scene tells lag and play. @param rows  of the tracker.
  ArmSwing(const model::Arm& arm, const VisualServoConfig& config, bool known,
           const std::vector<int>& rows);

  const estimation::ResponseEstimator& response() const { return response_; }
  /// The mode that the scene tells, or that was found.
  const std::optional<estimation::Mode>& mode() const { return mode_; }
  /// Time constant of the correction: longer for a slow mode [s].
  double smoothing() const { return smoothing_; }

  /// Advances the estimate to a picture. @param pressures  as of ResponseEstimator::moveTo().
  void moveTo(double stamp, const estimation::ResponseEstimator::Pressures& pressures);
  /// Compares it with the picture. @param moved  something else moves the arm: it is left out.
  void learn(const model::Twists& measured, const estimation::ArmFilter& tracker, bool moved);
  /// Forgets everything that pictures told.
  void reset();

  /// Measured twists without the swing.
  model::Twists atRest(const model::Twists& measured, const estimation::ArmFilter& tracker) const;
  /// Most that the known mode adds to each row.
  Eigen::VectorXd peak(const estimation::ArmFilter& tracker) const;
  /// Most that a mode which is not known yet adds to each row.
  Eigen::VectorXd possible(const estimation::ArmFilter& tracker) const;
  /// Covariance of twists (6 sections x 6 sections) by a swing of this part of its peak.
  Eigen::MatrixXd noise(double part, const estimation::ArmFilter& tracker) const;
  /// By how much the lag may be off [s].
  double lagDoubt() const;
  /// Covariance of twists by the error of the lag.
  Eigen::MatrixXd lagNoise(const estimation::ArmFilter& tracker) const;

 private:
  Eigen::VectorXd rowsOf(const Eigen::VectorXd& swing, const estimation::ArmFilter& tracker) const;

  const std::optional<estimation::Mode> told_;
  const double usual_smoothing_, time_constant_;
  const int sections_;
  std::vector<int> bends_;  // indices of rows that bend
  estimation::ResponseEstimator response_;
  Eigen::VectorXd peak_;   // largest swing, which fades as the mode does (n) [m]
  double swung_at_ = 0.0;  // [s]
  std::optional<estimation::Mode> mode_;
  double smoothing_;  // [s]
};

}  // namespace helix_arm::follow
