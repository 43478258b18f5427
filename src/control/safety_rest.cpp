#include <cmath>
#include <limits>

#include "helix_arm/control/safety.hpp"

// Rest: a commander ends without a fault.

namespace helix_arm::control {

bool SafetyCore::rest(double now) {
  pass(now);
  if (report_.state != SafetyState::kEnabled) return false;
  if (report_.resting) return true;
  report_.resting = true;
  ++report_.changes;
  goal_.setZero();
  down_at_ = target_at_ = std::numeric_limits<double>::infinity();  // no further target is required
  return true;
}

void SafetyCore::cancelRest() {
  report_.resting = false;
  ++report_.changes;
  for (int i = 0; i < count(); ++i) goal_[i] = startOf(i);
}

void SafetyCore::endRest() {
  if ((orders_.set_point.array() != 0).any()) return;
  if (std::isinf(down_at_)) down_at_ = now_;
  for (int i = 0; i < count(); ++i) {
    if (watch_[i].empty(now_, rules_)) continue;
    if (now_ - down_at_ > rules_.vent_time) {
      raise(SafetyCause::kNotVenting, i, reading_[i], rules_.vented_below);
    }
    return;
  }
  for (int i = 0; i < count(); ++i) release(i);
  setState(SafetyState::kDisabled, SafetyCause::kNone, -1, 0, 0);
  rested_ = true;
}

}  // namespace helix_arm::control
