#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "aim.hpp"
#include "helix_arm/control/pressure_observer.hpp"
#include "helix_arm/model/arm_response.hpp"
#include "helix_arm/tracking/response_estimator.hpp"

namespace helix_arm::follow {

/// Values by ascending time; the oldest of too many are forgotten. Does not allocate.
template <class Value, int kMost>
class TimeRing {
 public:
  void clear() { count_ = 0; }
  /// @param time  not before the last one, or everything earlier is forgotten.
  void add(double time, const Value& value) {
    if (count_ > 0 && time < at(0).time) clear();
    newest_ = (newest_ + 1) % kMost;
    Entry& entry = entries_[static_cast<std::size_t>(newest_)];
    entry.time = time;
    entry.value = value;
    if (count_ < kMost) ++count_;
  }
  /// The last value at or before a time; null if all are later. Valid until the next change.
  const Value* find(double time) const {
    for (int age = 0; age < count_; ++age) {
      if (at(age).time <= time) return &at(age).value;
    }
    return nullptr;
  }

  struct Entry {
    double time;
    Value value;
  };
  int count() const { return count_; }
  /// The newest has the age 0.
  const Entry& at(int age) const {
    return entries_[static_cast<std::size_t>((newest_ - age + kMost) % kMost)];
  }

 private:
  std::array<Entry, kMost> entries_ = {};
  int newest_ = -1;
  int count_ = 0;
};

/// Effective pressures of actuators with lag or play while an observer estimates their pressures.
/// Of an arm whose scene tells neither, they are what an estimator learns.
///
/// All memory is allocated in the constructor.
class ResponseTracker {
 public:
  explicit ResponseTracker(const model::Arm& arm)
      : arm_(arm),
        response_(arm_),
        learns_(response_.instant()),
        effective_(arm_.inputAt(0.0)),
        beyond_(Eigen::VectorXd::Zero(effective_.size())),
        lower_(lowestPressures(arm_)),
        upper_(highestPressures(arm_)),
        pressure_(effective_),
        asked_(effective_),
        play_(Eigen::VectorXd::Zero(effective_.size())),
        crossed_(play_),
        then_{effective_, effective_} {
    release();
    // Each entry of the ring gets its memory.
    for (int i = 0; i < kMostTurns; ++i) history_.add(i, beyond_);
    history_.clear();
  }

  /// From now on the actuators follow so, if the scene tells nothing.
  void learn(const estimation::ResponseEstimator& found) {
    if (!learns_) return;
    dead_ = found.deadTime();
    lag_ = found.lag().value - dead_;
    sure_ = sureOf(found.lag());
    response_.set(lag_, sureOf(found.play()) * found.play().value);
  }
  /// Takes these pressures (n) [Pa] for the effective ones at a time, and follows the observer from
  /// there.
  void restart(double time, const Eigen::VectorXd& effective,
               const control::PressureObserver& observer) {
    if (!learns_) return;
    response_.restart();
    response_.follow(time, effective);
    history_.clear();
    for (; time < observer.time(); time += kReplayed) {
      if (!observer.at(time, then_)) continue;
      const Eigen::VectorXd pressure = then_.pressure;
      if (dead_ > 0) observer.at(time - dead_, then_);
      response_.follow(time, then_.pressure);
      history_.add(time, response_.effective() - pressure);
    }
    follow(observer);
  }
  /// To lead paths by, of actuators whose scene tells nothing.
  Aim::Late late() const { return {sure_ * dead_, sure_ * lag_}; }
  bool learns() const { return learns_; }

  /// Follows the newest estimate, if there is one.
  void follow(const control::PressureObserver& observer) {
    if (!observer.started()) return;
    const Eigen::VectorXd& pressure = observer.newest().pressure;
    then_.pressure = pressure;
    if (dead_ > 0) observer.at(observer.time() - dead_, then_);
    if (response_.follow(observer.time(), then_.pressure)) history_.clear();
    effective_ = response_.effective();
    beyond_ = effective_ - pressure;
    history_.add(observer.time(), beyond_);
    response_.effectiveLimits(arm_, lower_, upper_);
  }

  /// Effective pressures (n) at the newest estimate, if there is one [Pa].
  const Eigen::VectorXd& effective() const { return effective_; }

  /// Turns estimates into those of the effective pressures; an unknown start adds to the variance.
  void apply(double time, control::PressureObserver::Estimate& estimate) const {
    if (const Eigen::VectorXd* beyond = history_.find(time)) estimate.pressure += *beyond;
    // Evenly distributed between its bounds.
    estimate.variance += response_.uncertainty(arm_).cwiseAbs2() / 3.0;
  }

  /// Limits an aim to effective pressures that are attainable from here.
  void limit(Aim& aim) const { aim.limit(lower_, upper_); }

  /// Pressures (n) with these effective pressures [Pa]. Where the target moves, a play is crossed
  /// at once: the change is led by a part of the lags, since the jolt of a muscle that turns late
  /// makes the arm swing.
  /// @param dt             since the last call [s].
  /// @param time_constant  of the regulator; 0 at rest, where noise would make muscles turn [s].
  const Eigen::VectorXd& pressureFor(const Eigen::VectorXd& effective, double dt,
                                     double time_constant) {
    // Within a learnt play, noise of the readings would move a command that holds.
    if (learns_ && (effective - asked_).cwiseAbs().maxCoeff() < kHeld) return pressure_;
    asked_ = effective;
    response_.inputsFor(arm_, effective, pressure_);
    play_ = pressure_ - effective;
    if (time_constant == 0) crossed_ = play_;
    for (int i = 0; i < arm_.actuatorCount(); ++i) {
      const double left = play_[i] - crossed_[i];
      const model::Actuator& actuator = arm_.actuator(i);
      const model::Response& told = actuator.response;
      const double lag = time_constant + late().lag + (left > 0 ? told.rise_time : told.fall_time);
      pressure_[i] = std::clamp(pressure_[i] + kLed * lag / kCrossing * left, actuator.limits.lower,
                                actuator.limits.upper);
    }
    crossed_ -= std::expm1(-dt / kCrossing) * (play_ - crossed_);
    return pressure_;
  }
  /// Nothing is commanded: the next command is no held one.
  void release() { asked_.setConstant(-std::numeric_limits<double>::infinity()); }

 private:
  static constexpr int kMostTurns = 512;     // more than a second at 500 Hz, and than a replay
  static constexpr double kCrossing = 0.05;  // time constant of a play that is crossed [s]
  static constexpr double kLed = 0.5;        // part of the lags, which are known roughly
  static constexpr double kReplayed = 0.01;  // step of a replay [s]
  static constexpr double kHeld = 1.0;       // an effective pressure that changes by less [Pa]

  // The part of an estimate to reckon with: what the pictures hardly show is not made up for.
  static double sureOf(const estimation::Estimated& found) {
    const double value2 = found.value * found.value;
    return value2 > 0 ? value2 / (value2 + found.deviation * found.deviation) : 0.0;
  }

  const model::Arm arm_;
  model::ArmResponse response_;
  const bool learns_;              // the scene tells no lag or play of any actuator
  double lag_ = 0.0, dead_ = 0.0;  // [s]
  double sure_ = 0.0;              // part of these
  Eigen::VectorXd effective_;
  Eigen::VectorXd beyond_;  // the pressures (n) [Pa]
  Eigen::VectorXd lower_, upper_, pressure_, asked_;
  Eigen::VectorXd play_,
      crossed_;  // pressures beyond the effective ones, and what is reached (n) [Pa]
  control::PressureObserver::Estimate then_;  // a dead time ago
  TimeRing<Eigen::VectorXd, kMostTurns> history_;
};

}  // namespace helix_arm::follow
