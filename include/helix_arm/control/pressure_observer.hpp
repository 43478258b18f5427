#pragma once

#include <Eigen/Core>
#include <vector>

namespace helix_arm::control {

/// Estimates the true pressures between and behind noisy readings: one scalar Kalman filter per
/// channel, driven by the set point through the regulator's first-order lag.
///
/// All memory is allocated in the constructor. Time is a number [s]; a time before the last one
/// empties the history.
class PressureObserver {
 public:
  /// Estimates at one time.
  struct Estimate {
    Eigen::VectorXd pressure;  ///< (n) gauge [Pa]
    Eigen::VectorXd variance;  ///< (n) [Pa^2]
  };

  /// Time for which estimates are kept [s].
  static constexpr double kMemory = 3.0;

  /// @param channels       >= 1.
  /// @param time_constant  of the regulator's lag, > 0 [s].
  /// @param noise          standard deviation of a reading, > 0 [Pa].
  /// @throws std::invalid_argument naming the value and its rule.
  PressureObserver(int channels, double time_constant, double noise);

  /// Takes the readings of one time.
  /// @param set_point  (n) in force since the last readings [Pa].
  /// @param reading    (n) [Pa]; NaN where a channel gave none.
  /// Neither counts outside kPossibleReading.
  void update(double time, const Eigen::VectorXd& set_point, const Eigen::VectorXd& reading);

  /// Forgets everything; the next reading starts anew.
  void restart();

  /// Whether a reading of every channel has come.
  bool started() const { return count_ > 0; }
  double time() const;      ///< of the newest estimate [s]
  double earliest() const;  ///< of the oldest estimate [s]
  const Estimate& newest() const { return now_; }

  /// Estimates at a time within the history, by linear interpolation. Returns false, and leaves
  /// `out` as it is, for times after the newest or before the oldest estimate.
  bool at(double time, Estimate& out) const;
  /// Estimates at a time after the newest one, if the set point stays what it was. Looks at least
  /// 50 ms ahead, 1.5 periods of the readings if that is longer, at most a second; returns false,
  /// and leaves `out` as it is, for other times.
  bool ahead(double time, Estimate& out) const;

 private:
  struct Moment {
    double time;
    Estimate estimate;
  };
  const Moment& moment(int age) const;  // 0: the newest
  void remember(double time);
  void predict(double dt, Estimate& estimate) const;

  const double time_constant_;
  const double noise_;
  Estimate now_;
  Eigen::VectorXd set_point_;    // in force until now_; NaN if unknown
  std::vector<Moment> history_;  // a ring
  int newest_ = -1;
  int count_ = 0;
};

}  // namespace helix_arm::control
