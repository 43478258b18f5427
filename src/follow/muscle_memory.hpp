#pragma once

#include <Eigen/Core>

#include "aim.hpp"
#include "helix_arm/control/pressure_observer.hpp"
#include "helix_arm/model/arm_response.hpp"
#include "time_ring.hpp"

namespace helix_arm::follow {

/// What actuators with lag or play feel while an observer estimates their pressures. Of an arm
/// without a response it does nothing, and pressures are felt as they are.
///
/// All memory is allocated in the constructor.
class MuscleMemory {
 public:
  explicit MuscleMemory(const model::Arm& arm);

  /// Follows the newest estimate, if there is one.
  void follow(const control::PressureObserver& observer);
  /// Pressures (n) felt at the newest estimate, if there is one [Pa].
  const Eigen::VectorXd& felt(const control::PressureObserver& observer) const {
    return active_ ? felt_ : observer.newest().pressure;
  }
  /// Turns estimates at a time into those of the pressures felt then. What is unknown of the start
  /// adds to their variance.
  void apply(double time, control::PressureObserver::Estimate& estimate) const;

  /// Limits an aim to what can come to be felt from here.
  void limit(Aim& aim) const;
  /// Pressures (n) that come to be felt as these [Pa].
  const Eigen::VectorXd& pressureFor(const Eigen::VectorXd& felt);

 private:
  static constexpr int kMostTurns = 512;  // more than the observer's memory at 200 Hz

  const model::Arm arm_;
  model::ArmResponse response_;
  const bool active_;  // an actuator has a response
  Eigen::VectorXd felt_, beyond_, lower_, upper_, pressure_;
  TimeRing<Eigen::VectorXd, kMostTurns> history_;  // of what was felt beyond the pressure
};

}  // namespace helix_arm::follow
