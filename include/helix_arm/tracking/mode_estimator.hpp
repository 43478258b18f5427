#pragma once

#include <Eigen/Core>
#include <functional>
#include <optional>

#include "helix_arm/model/arm.hpp"

namespace helix_arm::estimation {

/// The slowest mode of vibration of an arm: it bends. All else follows at once.
struct Mode {
  double frequency;                  ///< undamped, of the arm at rest, > 0 [Hz]
  double damping;                    ///< ratio, in (0, 1)
  double frequency_deviation = 0.0;  ///< standard error [Hz]; 0: told, not estimated
  double damping_deviation = 0.0;    ///< likewise
};

/// Whether a row of the twists [v; w] is a bend, w_y or w_z.
constexpr bool bends(int row) { return row % 6 > 3; }

/// Factor on the mode's frequency at lengths (n) [m]: that of rest over the present length, since
/// at a constant moment for each radian of bend the frequency goes with 1 / length.
double paceOf(const model::Arm& arm, const Eigen::Ref<const Eigen::VectorXd>& lengths);

/// Longest step at which a mode up to 8 Hz is followed to 1 % [s].
inline constexpr double kSwingStep = 0.01;
/// A pause between pictures after which the arm is taken to rest [s].
inline constexpr double kSwingPause = 1.0;
/// Root mean square of the motion from which on it says something, in expected errors.
inline constexpr double kLeastMotion = 0.3;

/// Finds the mode of vibration of an arm from pictures of its motion.
///
/// Each hypothesis is a lag that the pressures pass, and a mode that the lengths pass after it. Its
/// output, by the model's Jacobian and a free gain of each bend, is compared with the measured
/// ones; both pass a high-pass filter, so that offsets do not count. The likeliest mode counts once
/// it explains the motion clearly better than every hypothesis without one. Frequency and damping
/// are interpolated between hypotheses; their standard errors come from the curvature of the
/// likelihood.
///
/// Time is a number [s].
class ModeEstimator {
 public:
  /// Pressures (n) at a time of the last second [Pa].
  using Pressures = std::function<const Eigen::VectorXd&(double time)>;

  /// @param lag_is_known  the pressures contain all lags of the arm.
  ModeEstimator(const model::Arm& arm, bool lag_is_known);

  /// Advances all hypotheses to the time of a picture. A pause of more than a second, or a time
  /// that goes back, starts at rest.
  void moveTo(double time, const Pressures& pressures);
  /// Compares them with the picture. @param measured  (d) entries of the twists that bend.
  /// @param by_lengths  (d x n) derivative of the model's. Both in units of the expected errors.
  void compare(const Eigen::VectorXd& measured, const Eigen::MatrixXd& by_lengths);
  void reset();

  /// Nothing as long as the pictures show none.
  const std::optional<Mode>& mode() const { return mode_; }
  /// A lag, and the pressures (n) behind it at the last time [Pa].
  struct Late {
    double lag, deviation;  ///< [s]
    Eigen::VectorXd lagged;
  };
  /// The lag that explains the motion best: with this mode, or each lag with the mode or none that
  /// suits it best, so that no slow mode passes for a lag. Nothing where that explains the motion
  /// hardly better than the given lag, and once pictures have shown 3 s of motion.
  std::optional<Late> otherLag(double lag, const std::optional<Mode>& mode) const;
  /// Most that a mode which the pictures have not refuted, at a damping of 0.16, adds to the
  /// lengths after their rates have changed (n) [m].
  const Eigen::VectorXd& possibleSwing() const { return possible_; }

 private:
  void restart(const Eigen::VectorXd& pressure);
  void step(const Eigen::VectorXd& pressure, double dt);
  Eigen::Index placeOf(const Mode& mode) const;
  void judge();
  void findPossible(double dt);
  void choose();

  const model::Arm arm_;
  Eigen::ArrayXd lags_;            // (T)
  Eigen::ArrayXd turn_, damping_;  // (K) of each hypothesis, ordered by lag; turn 0: no mode
  Eigen::ArrayXXd lagged_, goal_;  // (n x T) pressures behind each lag, their lengths
  Eigen::MatrixXd x_, v_, last_x_, passed_;   // (K x n) lengths
  Eigen::VectorXd last_measured_, measured_;  // (d) the latter behind the high-pass filter
  Eigen::ArrayXXd output_, cross_, power_;    // (K x d) weighted sums
  Eigen::ArrayXd energy_;                     // (d) of the measurement
  Eigen::ArrayXd residual_;                   // (K) of the energy
  Eigen::MatrixXd beyond_;                    // of its modes, lengths less their goals
  Eigen::VectorXd possible_;                  // (n)
  double weight_ = 0.0;                       // of pictures
  double compared_for_ = 0.0;                 // in motion [s]
  std::optional<double> time_, compared_;     // of the hypotheses; of the last comparison [s]
  std::optional<Mode> mode_;
};

}  // namespace helix_arm::estimation
