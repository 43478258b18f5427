#pragma once

#include <optional>
#include <string>
#include <vector>

#include "helix_arm/localization/twist_fit.hpp"

namespace helix_arm::estimation {

/// Learns base and border shift from pictures, in which they are constant while the arm moves.
///
/// A fit that frees them anew in every picture takes half of what a force does to the arm for a
/// motion of its base. Pictures of different shapes tell the two apart: each picture whose shape is
/// a new one teaches. Once noise contributes at most kSurest of the priors' deviations, the
/// estimate is held: it changes slowly while the arm moves, as the camera may be pushed.
///
/// Errors of the placements do not average out. With z the base and border shift for which the
/// pictures speak, P0 the priors' covariance and Q that of z's errors by placements, the estimate
/// is P0 (P0 + Q)^-1 z once noise is negligible: no farther from the nominal values than placements
/// leave reason for.
class RigMemory {
 public:
  static constexpr double kSurest = 0.02;

  /// Starts with the priors of the options. @param by_placements  Q, positive semidefinite.
  RigMemory(const TwistFitOptions& options, const RigEstimate::Matrix& by_placements);

  /// For the next fit. Its covariance is that of noise alone, so that successive fits agree.
  const RigEstimate& estimate() const { return estimate_; }
  /// Whether the estimate is held, or there is none.
  bool isHeld() const { return held_; }

  /// After a fit that knew estimate(). One that has not converged teaches nothing; 30 in a row that
  /// explain no picture show that the camera was moved: all begins anew.
  void learn(const TwistFit& fit);
  void reset();

  /// The options with priors as narrow as those of the fits once the estimate is held.
  static TwistFitOptions heldOptions(TwistFitOptions options);
  /// Covariance of the errors of an estimate that is held.
  static RigEstimate::Matrix heldErrors(const TwistFitOptions& options,
                                        const RigEstimate::Matrix& by_placements);

 private:
  bool isNew(const model::Twists& twists) const;
  void conclude();

  TwistFitOptions options_;
  RigEstimate::Matrix by_placements_;
  RigEstimate estimate_;
  // Information of the pictures alone, as if placements were exact.
  RigEstimate::Matrix information_ = RigEstimate::Matrix::Zero();
  RigEstimate::Vector weighted_ = RigEstimate::Vector::Zero();  // information times z
  bool teaches_ = false, held_ = false;
  std::optional<model::Twists> taught_;  // of the last picture that taught
  int failures_ = 0;                     // in a row
};

/// The camera or the arm's base, where it is not as expected.
struct BaseMove {
  /// Log of the base seen from the nominal one, or from where earlier pictures showed it [m, rad].
  lie::Vector6 xi = lie::Vector6::Zero();
  double deviations = 0.0;    ///< of what is known of it, by Mahalanobis
  bool since_before = false;  ///< it was elsewhere in earlier pictures
  bool of_bodies = false;     ///< a motion-capture system stands for the camera

  /// The part that has moved, by how much, and the remedy.
  std::string message() const;
};

/// Says that the camera or the arm's base has moved, from fits that know nothing of the base.
///
/// With x the base of such a fit, C its covariance, P0 that of the prior and Q that of errors by
/// placements, x' (C + P0 + Q)^-1 x beyond 25 in three fits in a row is a move. So is the same of x
/// less its mean in earlier fits with a quarter of P0 + Q: errors by placements change little.
class BaseWatch {
 public:
  /// Arguments as for TwistFitter and RigMemory.
  BaseWatch(TagLayout layout, int sections, const TwistFitOptions& options,
            const RigEstimate::Matrix& by_placements);

  static constexpr int kPeriod = 10;  ///< pictures a fit

  /// A picture; one of kPeriod is fitted. Arguments as for TwistFitter::fit().
  void see(const std::vector<CornerObservation>& seen, const lie::SE3& X_CB, double focal,
           const model::Shape& start, const model::Shape& model);
  void see(const std::vector<PoseObservation>& seen, const model::Shape& start,
           const model::Shape& model);
  /// Nothing as long as camera and base are where they are expected.
  const std::optional<BaseMove>& move() const { return move_; }
  void reset();

 private:
  bool isDue() { return pictures_++ % kPeriod == 0; }
  void judge(const TwistFit& fit);
  BaseMove moveOf(const RigEstimate& rig) const;

  TwistFitter fitter_;
  const Eigen::Matrix<double, 6, 6> known_;  // P0 + Q
  int pictures_ = 0;
  lie::Vector6 usual_ = lie::Vector6::Zero();  // mean of the fits that showed no move
  int fits_ = 0;                               // of that mean
  int contradictions_ = 0;                     // fits in a row that contradict `move_`
  std::optional<BaseMove> move_;
};

}  // namespace helix_arm::estimation
