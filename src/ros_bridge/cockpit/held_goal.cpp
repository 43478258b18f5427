#include "ros_bridge/cockpit/held_goal.hpp"

#include <utility>

namespace helix_arm::ros_bridge {

void HeldGoal::begin(double now, CockpitGoal goal) {
  if (goal_ == CockpitGoal::kNone) waits_since_.reset();
  if (goal_ != goal) answered_at_ = now;  // a slider that is dragged on is no answer
  goal_ = goal;
  last_look_ = now;
  answer_.clear();
  refused_ = short_of_ = false;
}

void HeldGoal::holdPressures(double now, std::vector<double> pressure) {
  begin(now, CockpitGoal::kPressures);
  pressures_ = std::move(pressure);
}

void HeldGoal::holdTip(double now, const std::array<double, 3>& position) {
  begin(now, CockpitGoal::kTip);
  tip_ = position;
}

void HeldGoal::end(const std::string& why) {
  goal_ = CockpitGoal::kNone;
  answer_ = why;
  refused_ = short_of_ = false;
  waits_since_.reset();
}

void HeldGoal::noteState(bool enabled, const std::string& reason) {
  if (goal_ == CockpitGoal::kNone || enabled) return;
  end("the hold ended with the arm: " + reason);
}

void HeldGoal::noteAnswer(double now, bool dropped, const std::string& fault,
                          const std::string& message) {
  if (goal_ == CockpitGoal::kNone) return;
  answered_at_ = now;
  answer_ = message;
  refused_ = dropped;
  short_of_ = false;
  if (!dropped) {
    waits_since_.reset();
  } else if (fault == "other_commander") {
    if (!waits_since_) waits_since_ = now;
  } else if (fault != "stale") {  // the next one may be in time
    end(message);
    refused_ = true;
  }
}

bool HeldGoal::turn(double now) {
  if (goal_ == CockpitGoal::kNone) return false;
  if (now - last_look_ > kBlind) {
    end("the hold ended: the window did not respond");
    return false;
  }
  if (now - answered_at_ > kUnanswered) {
    end("the hold ended: nothing answers its targets; is the node that takes them alive?");
    refused_ = true;
    return false;
  }
  if (waits_since_ && now - *waits_since_ > kPatience) {
    const std::string why = answer_;
    end("another commander keeps the arm: " + why);
    refused_ = true;
    return false;
  }
  return true;
}

}  // namespace helix_arm::ros_bridge
