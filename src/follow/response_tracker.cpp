#include "response_tracker.hpp"

namespace helix_arm::follow {

ResponseTracker::ResponseTracker(const model::Arm& arm)
    : arm_(arm),
      response_(arm_),
      active_(!response_.instant()),
      effective_(arm_.inputAt(0.0)),
      beyond_(Eigen::VectorXd::Zero(effective_.size())),
      lower_(lowestPressures(arm_)),
      upper_(highestPressures(arm_)),
      pressure_(effective_) {
  // Each entry of the ring gets its memory.
  for (int i = 0; active_ && i < kMostTurns; ++i) history_.add(i, beyond_);
  history_.clear();
}

void ResponseTracker::follow(const control::PressureObserver& observer) {
  if (!active_ || !observer.started()) return;
  const Eigen::VectorXd& pressure = observer.newest().pressure;
  if (response_.follow(observer.time(), pressure)) history_.clear();
  effective_ = response_.effective();
  beyond_ = effective_ - pressure;
  history_.add(observer.time(), beyond_);
  response_.effectiveLimits(arm_, lower_, upper_);
}

void ResponseTracker::apply(double time, control::PressureObserver::Estimate& estimate) const {
  if (!active_) return;
  if (const Eigen::VectorXd* beyond = history_.find(time)) estimate.pressure += *beyond;
  // Evenly distributed between its bounds.
  estimate.variance += response_.uncertainty().cwiseAbs2() / 3.0;
}

void ResponseTracker::limit(Aim& aim) const {
  if (active_) aim.limit(lower_, upper_);
}

const Eigen::VectorXd& ResponseTracker::pressureFor(const Eigen::VectorXd& effective) {
  if (!active_) return effective;
  response_.inputsFor(arm_, effective, pressure_);
  return pressure_;
}

}  // namespace helix_arm::follow
