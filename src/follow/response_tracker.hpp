#pragma once

#include <Eigen/Core>
#include <array>
#include <optional>

#include "aim.hpp"
#include "helix_arm/control/pressure_observer.hpp"
#include "helix_arm/model/arm_response.hpp"

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
  /// The same as a copy.
  std::optional<Value> before(double time) const {
    const Value* const found = find(time);
    return found != nullptr ? std::optional<Value>(*found) : std::nullopt;
  }

 private:
  struct Entry {
    double time;
    Value value;
  };
  const Entry& at(int age) const {
    return entries_[static_cast<std::size_t>((newest_ - age + kMost) % kMost)];
  }

  std::array<Entry, kMost> entries_ = {};
  int newest_ = -1;
  int count_ = 0;
};

/// Effective pressures of actuators with lag or play while an observer estimates their pressures.
/// Of an arm without a response it does nothing: effective pressures are the pressures themselves.
///
/// All memory is allocated in the constructor.
class ResponseTracker {
 public:
  explicit ResponseTracker(const model::Arm& arm);

  /// Follows the newest estimate, if there is one.
  void follow(const control::PressureObserver& observer);
  /// Effective pressures (n) at the newest estimate, if there is one [Pa].
  const Eigen::VectorXd& effective(const control::PressureObserver& observer) const {
    return active_ ? effective_ : observer.newest().pressure;
  }
  /// Turns estimates at a time into those of the effective pressures then. What is unknown of the
  /// start adds to their variance.
  void apply(double time, control::PressureObserver::Estimate& estimate) const;

  /// Limits an aim to effective pressures that are attainable from here.
  void limit(Aim& aim) const;
  /// Pressures (n) with these effective pressures [Pa].
  const Eigen::VectorXd& pressureFor(const Eigen::VectorXd& effective);

 private:
  static constexpr int kMostTurns = 512;  // more than the observer's memory at 200 Hz

  const model::Arm arm_;
  model::ArmResponse response_;
  const bool active_;  // an actuator has a response
  Eigen::VectorXd effective_, beyond_, lower_, upper_, pressure_;
  TimeRing<Eigen::VectorXd, kMostTurns> history_;  // of effective pressure beyond the pressure
};

}  // namespace helix_arm::follow
