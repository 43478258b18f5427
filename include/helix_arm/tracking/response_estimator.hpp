#pragma once

#include <Eigen/Core>
#include <array>
#include <optional>

#include "helix_arm/model/arm.hpp"
#include "helix_arm/tracking/mode_estimator.hpp"

namespace helix_arm::estimation {

/// A value with its standard error.
struct Estimated {
  double value = 0.0, deviation = 0.0;
};

/// Finds from pictures of its motion how an arm follows its pressures: a dead time, which contains
/// errors of the pictures' stamps, a lag, a play of its actuators, and a mode of vibration.
///
/// Recursive least squares: these and a factor on the effect of each actuator, by the derivatives
/// of the measured bends, of which a high-pass filter leaves the motion. It begins with an arm that
/// follows at once, and with a mode once one is told or a ModeEstimator finds it.
///
/// Time is a number [s].
class ResponseEstimator {
 public:
  /// Pressures (n) at a time of the last second [Pa]; valid until the next call.
  using Pressures = ModeEstimator::Pressures;

  /// @param known  the pressures contain lag and play of the arm. @param told  a mode to begin
  /// with.
  ResponseEstimator(const model::Arm& arm, bool known, const std::optional<Mode>& told);

  /// Advances the model to the time of a picture. A pause of more than 0.7 s, or a time that
  /// goes back, starts at rest.
  void moveTo(double time, const Pressures& pressures);
  /// Compares it with the picture. @param measured  (d) entries of the twists that bend.
  /// @param by_lengths  (d x n) derivative of the model's. Both in units of the expected errors.
  void compare(const Eigen::VectorXd& measured, const Eigen::MatrixXd& by_lengths);
  /// Leaves a picture out, since something else moves the arm: later motion is compared anew.
  void skip() { compared_.reset(); }
  void reset();

  /// Dead time and lag together, >= 0; 0 if they are known [s].
  Estimated lag() const;
  /// Its part that is a dead time [s].
  double deadTime() const { return state_[gains_ + 2]; }
  /// Half the width of the hysteresis, >= 0; 0 if it is known [Pa].
  Estimated play() const;
  /// Nothing as long as the pictures show none, and none is told.
  std::optional<Mode> mode() const;
  /// Contribution of that mode to the lengths at the last time (n) [m].
  const Eigen::VectorXd& swing() const { return swing_; }
  /// If the last picture made the lag another one: the pressures (n) behind it then [Pa].
  const std::optional<Eigen::VectorXd>& begunAnew() const { return begun_anew_; }
  /// As ModeEstimator::possibleSwing().
  const Eigen::VectorXd& possibleSwing() const { return modes_.possibleSwing(); }
  /// Change by a standard error of the lag in the lengths at the last time (n) [m].
  Eigen::VectorXd lagError() const;

 private:
  static constexpr int kParameters = 5;  // lag, play, dead time, ln frequency, ln damping
  // The model, with the estimate and with a little more of each parameter.
  struct Chain {
    double lag, play, dead, turn, damping;  // [s], [Pa], [s], [rad/s]
    Eigen::VectorXd lagged, played;         // pressures (n) [Pa]
    Eigen::VectorXd goal, lengths, rate;    // (n) [m], [m/s]
    Eigen::VectorXd last, passed;           // lengths at the last picture, behind the filter (n)
  };

  void restart(const Eigen::VectorXd& pressure);
  void step(Chain& chain, const Eigen::VectorXd& pressure, double dt) const;
  void setChains();
  void learn(const Eigen::MatrixXd& by_lengths, double dt);
  void setPrior();
  double deviation(Eigen::Index i) const;
  void begin(const Mode& mode);
  void beginAnew(const ModeEstimator::Late& late);

  const model::Arm arm_;
  const bool known_;
  const std::optional<Mode> told_;
  const Eigen::Index gains_;  // n
  ModeEstimator modes_;
  Eigen::VectorXd state_;       // factors, parameters
  Eigen::MatrixXd covariance_;  // of it
  bool swings_ = false;         // a mode is told or found
  double begun_ = 0.0;          // logarithm of its frequency [Hz] when it was
  double variance_;             // of the residual
  std::array<Chain, kParameters + 1> chains_;
  Eigen::VectorXd last_measured_, measured_, swing_;  // (d), (d), (n)
  std::optional<double> time_, compared_;             // [s]
  std::optional<Eigen::VectorXd> begun_anew_;
};

}  // namespace helix_arm::estimation
