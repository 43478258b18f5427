#pragma once

#include <Eigen/Core>
#include <memory>
#include <optional>

#include "helix_arm/tracking/arm_filter.hpp"
#include "helix_arm/tracking/tip_compliance.hpp"
#include "helix_arm/tracking/tracking_options.hpp"

namespace helix_arm::estimation {

/// A force on the arm that the model does not know.
struct ExternalLoad {
  bool contact = false;
  /// Twice the log likelihood ratio of a force against none: the largest of all times of onset,
  /// less while the arm moves, or during contact, that of the force.
  double score = 0.0;
  double onset = 0.0;  ///< of the contact [s]
  /// Base frame [N], or force per K_eps if it is normalised; of a dead force at `place` or, if that
  /// is not determined, at the tip. Zero without contact.
  Eigen::Vector3d force = Eigen::Vector3d::Zero();
  Eigen::Matrix3d covariance = Eigen::Matrix3d::Zero();
  /// (3 x 0 to 3) unit vectors along which the force exceeds three standard deviations.
  Eigen::Matrix3Xd determined = Eigen::Matrix3Xd(3, 0);
  /// How much farther the determined part of the force moves the tip than the fitted twists say,
  /// base frame [m]; see TipCompliance::tipBeyondFit().
  Eigen::Vector3d tip_beyond_fit = Eigen::Vector3d::Zero();
  /// Where it acts; nothing if the pictures do not tell.
  std::optional<ForcePlace> place;
  bool normalised = false;  ///< K_eps of the arm is unknown
  /// No shape of the model balances a force at the tip along every axis, or the tags do not
  /// determine it: some contacts, or all, are not found, whatever the score.
  bool blind = false;
};

/// Scores that would count as contacts while nothing touches the arm.
struct QuietScore {
  double highest = 0.0;  ///< score of all pictures in which a contact could have begun
  double seconds = 0.0;  ///< of these, those of a resting arm, in time of pictures [s]
  /// Force across the tip, in its weakest direction, that would score 1 within half a second: mean
  /// over the resting arm. Scores grow with its square [N].
  double unit_force = 0.0;
};

/// How far the measured tip has left the one that was learnt of the arm. A force that began or
/// ended at once, as found, is no drift.
struct Drift {
  /// For half a second, the distance has exceeded what is allowed: a load that came slowly, a
  /// camera or base that has moved, or a changed arm. Ends after half a second within that.
  bool doubtful = false;
  double distance = 0.0;  ///< [m]
  /// Distance by hysteresis, creep and noise: chi-square's 99.9 % point; at least 5 mm [m].
  double allowed = 0.0;
  double age = 0.0;  ///< of what was learnt, in time of pictures [s]
};

/// Finds contacts: copies a filter that watches the arm every few pictures, with a force from then
/// on, and compares "a force since then" with "none" at every later picture. This is a generalised
/// likelihood ratio test over the time of onset.
///
/// Finds drifts: keeps what the watch, with the force of a contact, knew of the arm every few
/// seconds of the last minute, and compares each picture with that. While a picture contradicts
/// most of it, nothing new is kept.
///
/// During contact the watch gets its state from the filter of the force, since it would take the
/// force for a difference of the arm from its model.
class OnsetHypotheses {
 public:
  /// @throws std::invalid_argument naming the value and its rule.
  explicit OnsetHypotheses(const OnsetOptions& options);
  ~OnsetHypotheses();
  OnsetHypotheses(OnsetHypotheses&&) noexcept;
  OnsetHypotheses& operator=(OnsetHypotheses&&) noexcept;

  /// After each picture of which the watch has made a step, even if it found it an outlier.
  /// @param time           of the picture [s].
  /// @param tip_deviation  standard deviation of the tip that the watch predicts, along its worst
  ///     direction [m]; contacts are found while it is below 3 mm.
  /// @param measured       the picture's shape.
  /// @param settled        the pressures are where they were ordered. Otherwise lags that the scene
  ///     does not know look like a drift, and `doubtful` stays as it is.
  /// @param motion         distance of the arm from where it settles, as part of what counts as
  ///     still. What the model times wrong looks like a force, so beyond 1 the score of what may
  ///     begin is divided by the square.
  /// @param compliance     moved to the arm's pressures.
  void see(double time, double tip_deviation, const model::Shape& measured, bool settled,
           double motion, ArmFilter& watch, TipCompliance& compliance);
  /// Adds to the covariance of b, (d x d) of the measured rows, in the watch too: other tags are
  /// seen, which err otherwise.
  void growBias(const Eigen::MatrixXd& covariance, ArmFilter& watch);
  /// Whether nothing counts as the begin of a contact: quiet() then goes on. It begins anew with
  /// this.
  void ignoreContacts(bool ignores);
  /// Forgets onsets, contact and drift; they are found again after ten seconds of pictures.
  void reset();

  /// After the last picture.
  const ExternalLoad& load() const;
  const Drift& drift() const;
  /// Scores of the pictures without contact since the last ignoreContacts(true).
  const QuietScore& quiet() const;

 private:
  struct Workspace;
  std::unique_ptr<Workspace> work_;
};

}  // namespace helix_arm::estimation
