#pragma once

#include <Eigen/Core>

#include "aim.hpp"
#include "helix_arm/control/pressure_observer.hpp"
#include "helix_arm/model/arm_response.hpp"
#include "time_ring.hpp"

namespace helix_arm::follow {

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
