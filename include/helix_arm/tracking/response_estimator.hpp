#pragma once

#include <Eigen/Core>
#include <array>
#include <functional>
#include <optional>

#include "helix_arm/model/arm.hpp"
#include "helix_arm/tracking/mode_estimator.hpp"

namespace helix_arm::estimation {

/// A value with its standard error.
struct Estimated {
  double value = 0.0, deviation = 0.0;
};

/// Finds from pictures of its motion how an arm follows its pressures: a lag, which contains dead
/// times and errors of the pictures' stamps, a play of its actuators, and a mode of vibration.
///
/// Recursive least squares: lag, play and mode, and a factor on the effect of each actuator, by the
/// derivatives of the measured bends, of which a high-pass filter leaves the motion. It begins with
/// neither lag nor play. Once a ModeEstimator finds a mode, it begins there; until then a fast one
/// stands for what the lag does not say, since its error would be taken for play.
///
/// Time is a number [s].
class ResponseEstimator {
 public:
  /// Pressures (n) at a time of the last second [Pa].
  using Pressures = std::function<const Eigen::VectorXd&(double time)>;

  /// @param known  the pressures contain lag and play of the arm. @param told  a mode to begin
  /// with.
  ResponseEstimator(const model::Arm& arm, bool known, const std::optional<Mode>& told);

  /// Advances the model to the time of a picture. A pause of more than a second, or a time that
  /// goes back, starts at rest.
  void moveTo(double time, const Pressures& pressures);
  /// Compares it with the picture. @param measured  (d) entries of the twists that bend.
  /// @param by_lengths  (d x n) derivative of the model's. Both in units of the expected errors.
  void compare(const Eigen::VectorXd& measured, const Eigen::MatrixXd& by_lengths);
  void reset();

  /// >= 0; 0 if they are known [s].
  Estimated lag() const { return {state_[gains_], std::sqrt(covariance_(gains_, gains_))}; }
  /// Half the width of the hysteresis, >= 0; 0 if it is known [Pa].
  Estimated play() const;
  /// Nothing as long as the pictures show none, and none is told.
  std::optional<Mode> mode() const;
  /// The mode, or of an arm that shows none what stands for all that is quicker than its lag;
  /// nothing if lag and play are known.
  std::optional<Mode> bending() const;
  /// What that adds to the lengths at the last time (n) [m].
  const Eigen::VectorXd& swing() const { return swing_; }
  /// What a standard error of the lag changes in the lengths at the last time (n) [m].
  Eigen::VectorXd lagError() const;

 private:
  static constexpr int kParameters = 4;  // lag, play, logarithms of frequency and damping
  // The model, with the estimate and with a little more of each parameter.
  struct Chain {
    double lag, play, turn, damping;      // [s], [Pa], [rad/s]
    Eigen::VectorXd lagged, played;       // pressures (n) [Pa]
    Eigen::VectorXd goal, lengths, rate;  // (n) [m], [m/s]
    Eigen::VectorXd last, passed;         // lengths at the last picture, behind the filter (n)
  };

  void restart(const Eigen::VectorXd& pressure);
  void step(const Eigen::VectorXd& pressure, double dt);
  void setChains();
  void learn(const Eigen::MatrixXd& by_lengths, double dt);
  void begin(const Mode& mode, double frequency_prior, double damping_prior);

  const model::Arm arm_;
  const bool known_;
  const std::optional<Mode> told_;
  const Eigen::Index gains_;  // n
  ModeEstimator modes_;
  Eigen::VectorXd state_;       // factors, lag, play, ln frequency, ln damping
  Eigen::MatrixXd covariance_;  // of it
  bool swings_ = false;
  double variance_;  // of the residual
  std::array<Chain, kParameters + 1> chains_;
  Eigen::VectorXd last_measured_, measured_, swing_;  // (d), (d), (n)
  std::optional<double> time_, compared_;             // [s]
  bool found_ = false;                                // a mode
  double modes_lag_ = 0.0;                            // lag at which modes_ began [s]
};

}  // namespace helix_arm::estimation
