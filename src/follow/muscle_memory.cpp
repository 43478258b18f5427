#include "muscle_memory.hpp"

namespace helix_arm::follow {

MuscleMemory::MuscleMemory(const model::Arm& arm)
    : arm_(arm),
      response_(arm_),
      active_(!response_.instant()),
      felt_(arm_.inputAt(0.0)),
      beyond_(Eigen::VectorXd::Zero(felt_.size())),
      lower_(lowestPressures(arm_)),
      upper_(highestPressures(arm_)),
      pressure_(felt_) {
  // Each entry of the ring gets its memory.
  for (int i = 0; active_ && i < kMostTurns; ++i) history_.add(i, beyond_);
  history_.clear();
}

void MuscleMemory::follow(const control::PressureObserver& observer) {
  if (!active_ || !observer.started()) return;
  const Eigen::VectorXd& pressure = observer.newest().pressure;
  if (response_.follow(observer.time(), pressure)) history_.clear();
  felt_ = response_.felt();
  beyond_ = felt_ - pressure;
  history_.add(observer.time(), beyond_);
  response_.feltLimits(arm_, lower_, upper_);
}

void MuscleMemory::apply(double time, control::PressureObserver::Estimate& estimate) const {
  if (!active_) return;
  if (const Eigen::VectorXd* beyond = history_.find(time)) estimate.pressure += *beyond;
  // Evenly distributed between its bounds.
  estimate.variance += response_.uncertainty().cwiseAbs2() / 3.0;
}

void MuscleMemory::limit(Aim& aim) const {
  if (active_) aim.limit(lower_, upper_);
}

const Eigen::VectorXd& MuscleMemory::pressureFor(const Eigen::VectorXd& felt) {
  if (!active_) return felt;
  response_.inputsFor(arm_, felt, pressure_);
  return pressure_;
}

}  // namespace helix_arm::follow
