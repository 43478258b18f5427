#include "helix_arm/control/safety.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <utility>

#include "helix_arm/basics/number_requirement.hpp"
#include "helix_arm/basics/requirement.hpp"

namespace helix_arm::control {
namespace {

// Of the pressure that counts as empty: what may still be there when noise shows a channel empty.
constexpr double kLeaving = 2.0;

// After a longer pause of the loop, the ramps continue with at most this step [s].
constexpr double kLongestStep = 0.1;

constexpr std::array<const char*, 4> kStateNames = {"disabled", "enabled", "fault", "vented"};
constexpr std::array<const char*, kSafetyCauseCount> kCauseNames = {
    "none",          "vent_requested", "emergency_stop", "stale_target",
    "stale_reading", "regulator_lost", "over_limit",     "low_supply",
    "not_following", "leak",           "not_venting",    "guard_lost"};

void require(bool holds, const char* what, double value, const char* rule) {
  basics::requireValue(holds, "safety rules", what, value, rule);
}

void requirePositive(const char* what, double value) {
  basics::requirePositive("safety rules", what, value);
}

void requireNotNegative(const char* what, double value) {
  basics::requireNotNegative("safety rules", what, value);
}

// Causes that vent every channel, whatever its action.
bool isGrave(SafetyCause cause) {
  switch (cause) {
    case SafetyCause::kVentRequested:
    case SafetyCause::kEmergencyStop:
    case SafetyCause::kRegulatorLost:  // a returning regulator does not know what was held
    case SafetyCause::kOverLimit:
    case SafetyCause::kLeak:
    case SafetyCause::kNotVenting:
    case SafetyCause::kGuardLost:
      return true;
    default:
      return false;
  }
}

// Causes that end as soon as messages come again.
bool passes(SafetyCause cause) {
  return cause == SafetyCause::kStaleTarget || cause == SafetyCause::kStaleReading ||
         cause == SafetyCause::kRegulatorLost;
}

void checkChannels(const std::vector<ChannelRules>& channels, const SafetyRules& rules) {
  basics::require(!channels.empty(), "safety core: no channels; expected at least one");
  for (const ChannelRules& channel : channels) {
    const char* const name = channel.name.c_str();
    const model::Range& limits = channel.limits;
    basics::require(!channel.name.empty(), "safety core: a channel has no name; expected one");
    basics::require(
        std::isfinite(limits.lower) && std::isfinite(limits.upper) && limits.lower <= limits.upper,
        name, ": the limits [Pa] are ", limits.lower, " to ", limits.upper,
        "; expected finite values, the lower first");
    basics::requireValue(channel.slew > 0, name, "slew [Pa/s]", channel.slew, "a value > 0");
    // Otherwise a reading could be above its limit and count as vented at once.
    const double nearest = std::min(highestReading(channel, rules), -lowestReading(channel, rules));
    basics::require(rules.vented_below < nearest, name, ": vented_below [Pa] is ",
                    rules.vented_below, "; expected less than ", nearest,
                    ", where it is over its limits by trip_margin");
  }
}

}  // namespace

const char* nameOf(SafetyState state) { return kStateNames[static_cast<std::size_t>(state)]; }
const char* nameOf(SafetyCause cause) { return kCauseNames[static_cast<std::size_t>(cause)]; }
const char* nameOf(FaultAction action) {
  switch (action) {
    case FaultAction::kVent:
      return "vent";
    case FaultAction::kHold:
      return "hold";
    case FaultAction::kClose:
      return "close";
  }
  return "";
}

void SafetyRules::validate() const {
  require(target_timeout > 0, "target_timeout [s]", target_timeout, "a value > 0");
  requirePositive("reading_timeout [s]", reading_timeout);
  requireNotNegative("trip_margin [Pa]", trip_margin);
  requireNotNegative("spike_time [s]", spike_time);
  if (min_supply) requirePositive("min_supply [Pa]", *min_supply);
  requirePositive("follow_tolerance [Pa]", follow_tolerance);
  requirePositive("follow_time [s]", follow_time);
  requirePositive("time_constant [s]", time_constant);
  requirePositive("fall_time_constant [s]", fallTimeConstant());
  requirePositive("leak_drop [Pa]", leak_drop);
  requireNotNegative("hold_time [s]", hold_time);
  requirePositive("vented_below [Pa]", vented_below);
  requirePositive("vent_time [s]", vent_time);
}

SafetyCore::SafetyCore(std::vector<ChannelRules> channels, const SafetyRules& rules)
    : channels_(std::move(channels)),
      rules_(rules),
      orders_(count()),
      goal_(Eigen::VectorXd::Zero(count())),
      reading_(Eigen::VectorXd::Constant(count(), std::numeric_limits<double>::quiet_NaN())),
      watch_(channels_.size()),
      vents_since_(channels_.size(), 0.0) {
  rules_.validate();
  checkChannels(channels_, rules_);
}

void SafetyCore::adopt(std::vector<ChannelRules> channels, const SafetyRules& rules) {
  rules.validate();
  checkChannels(channels, rules);
  basics::require(channels.size() == channels_.size(), channels.size(), " channels for a core of ",
                  channels_.size(), "; expected the same channels");
  for (int i = 0; i < count(); ++i) {
    const ChannelRules& channel = channels[i];
    basics::require(channel.name == channels_[i].name, "channel ", channel.name, " for ",
                    channels_[i].name, "; expected the same channels");
    if (orders_.valve[i] != Valve::kRegulate) continue;
    const bool inside = (report_.resting || channel.limits.contains(goal_[i])) &&
                        onTheWay(channel.limits).contains(orders_.set_point[i]);
    basics::require(inside, channel.name, " is commanded ", 1e-3 * goal_[i], " kPa and at ",
                    1e-3 * orders_.set_point[i], ", outside the new limits of ",
                    1e-3 * channel.limits.lower, " to ", 1e-3 * channel.limits.upper,
                    " kPa; command a pressure inside them first");
  }
  channels_ = std::move(channels);
  rules_ = rules;
}

bool SafetyCore::isVented() const {
  return report_.state == SafetyState::kDisabled || report_.state == SafetyState::kVented;
}

void SafetyCore::pass(double now) {
  if (!std::isfinite(now)) return;
  if (!started_) {
    started_ = true;
    now_ = turn_at_ = report_.since = now;
  }
  now_ = std::max(now_, now);
}

double SafetyCore::startOf(int i) const {
  const model::Range& limits = channels_[i].limits;
  return std::clamp(0.0, limits.lower, limits.upper);
}

void SafetyCore::setState(SafetyState state, SafetyCause cause, int channel, double value,
                          double limit) {
  report_.state = state;
  report_.cause = cause;
  report_.channel = channel;
  report_.value = value;
  report_.limit = limit;
  report_.since = now_;
  report_.vent_overdue = false;
  report_.resting = false;
  rested_ = false;
  ++report_.changes;
  // Noise may show an arm empty whose last pressure has hardly left.
  if (state != SafetyState::kDisabled && state != SafetyState::kVented) return;
  for (ChannelWatch& watch : watch_) watch.waitForEmpty();
}

// Handles a cause that occurs in a state in which it counts.
void SafetyCore::raise(SafetyCause cause, int channel, double value, double limit) {
  const bool regulated = report_.state == SafetyState::kEnabled;
  report_.passing = report_.passing && passes(cause);
  if (report_.state != SafetyState::kFault) {
    setState(SafetyState::kFault, cause, channel, value, limit);
    if (!regulated) std::fill(vents_since_.begin(), vents_since_.end(), now_);
  } else if (!isGrave(cause)) {
    return;
  }
  for (int i = 0; i < count(); ++i) {
    goal_[i] = orders_.set_point[i];
    const FaultAction action = channels_[i].action;
    // A channel that does not follow its set point cannot hold it either.
    const bool own = cause == SafetyCause::kNotFollowing && i == channel;
    if (isGrave(cause) || own || action == FaultAction::kVent) {
      release(i);
    } else if (action == FaultAction::kClose) {
      orders_.valve[i] = Valve::kClose;
    }
  }
}

void SafetyCore::release(int channel) {
  if (orders_.valve[channel] == Valve::kVent) return;
  orders_.valve[channel] = Valve::kVent;
  orders_.set_point[channel] = goal_[channel] = 0;
  vents_since_[channel] = now_;
}

std::string SafetyCore::enable(double now) {
  std::string refused = refusal(now);
  if (!refused.empty()) return refused;
  pass(now);
  setState(SafetyState::kEnabled, SafetyCause::kNone, -1, 0, 0);
  report_.passing = true;
  for (int i = 0; i < count(); ++i) {
    orders_.valve[i] = Valve::kRegulate;
    orders_.set_point[i] = 0;
    goal_[i] = startOf(i);
    watch_[i].begin(now_);
  }
  low_supply_.forget();
  target_at_ = std::numeric_limits<double>::infinity();
  turn_at_ = now_;
  return {};
}

bool SafetyCore::mayEnableItself() const { return isVented() && report_.passing; }

void SafetyCore::vent(double now) {
  pass(now);
  report_.passing = false;
  if (!isVented()) raise(SafetyCause::kVentRequested, -1, 0, 0);
}

void SafetyCore::emergencyStop(double now, bool engaged) {
  pass(now);
  if (engaged == report_.stopped) return;
  report_.stopped = engaged;
  ++report_.changes;
  if (engaged) raise(SafetyCause::kEmergencyStop, -1, 0, 0);
}

bool SafetyCore::target(double now, const Eigen::Ref<const Eigen::VectorXd>& pressure) {
  pass(now);
  if (report_.state != SafetyState::kEnabled || pressure.size() != count()) return false;
  if (!pressure.array().isFinite().any()) return false;
  if (report_.resting) cancelRest();
  for (int i = 0; i < count(); ++i) {
    if (!std::isfinite(pressure[i])) continue;
    goal_[i] = std::clamp(pressure[i], channels_[i].limits.lower, channels_[i].limits.upper);
  }
  target_at_ = now_;
  return true;
}

void SafetyCore::measured(double now, const Eigen::Ref<const Eigen::VectorXd>& pressure,
                          double supply, double age) {
  pass(now);
  if (pressure.size() != count()) return;
  const double asked = now_ - std::max(age, 0.0);
  for (int i = 0; i < count(); ++i) {
    if (!std::isfinite(pressure[i])) continue;
    reading_[i] = pressure[i];
    watch_[i].measured(now_, asked, pressure[i], channels_[i], rules_);
  }
  if (std::isfinite(supply)) {
    supply_ = supply;
    supply_at_ = asked;
    low_supply_.look(now_, rules_.min_supply && supply < *rules_.min_supply, rules_.spike_time);
  }
  watchReadings();
}

void SafetyCore::watchReadings() {
  // In order of severity: the report keeps the first one.
  for (int i = 0; i < count(); ++i) {
    if (!watch_[i].overLimit()) continue;
    const double highest = highestReading(channels_[i], rules_);
    raise(SafetyCause::kOverLimit, i, reading_[i],
          reading_[i] > highest ? highest : lowestReading(channels_[i], rules_));
  }
  const auto regulated = [this](int i) { return orders_.valve[i] != Valve::kVent; };
  for (int i = 0; i < count(); ++i) {
    if (!regulated(i) || !watch_[i].leaks()) continue;
    raise(SafetyCause::kLeak, i, watch_[i].drop(), rules_.leak_drop);
  }
  // Once the readings have shown an empty arm.
  const auto emptied = [this] { return report_.state == SafetyState::kVented || rested_; };
  for (int i = 0; emptied() && i < count(); ++i) {
    const bool leaves = !watch_[i].wasEmpty() && now_ - vents_since_[i] <= rules_.vent_time &&
                        std::abs(reading_[i]) < kLeaving * rules_.vented_below;
    if (!watch_[i].standing() || leaves) continue;
    raise(SafetyCause::kNotVenting, i, reading_[i], rules_.vented_below);
  }
  for (int i = 0; report_.state == SafetyState::kEnabled && i < count(); ++i) {
    if (!watch_[i].notFollowing()) continue;
    raise(SafetyCause::kNotFollowing, i, watch_[i].deviation(), rules_.follow_tolerance);
  }
  if (report_.state == SafetyState::kEnabled && low_supply_.lasts()) {
    raise(SafetyCause::kLowSupply, -1, supply_, *rules_.min_supply);
  }
}

void SafetyCore::linked(double now, bool up) {
  pass(now);
  if (up != link_up_) ++report_.changes;
  link_up_ = up;
  if (!up && !isVented()) raise(SafetyCause::kRegulatorLost, -1, 0, 0);
}

void SafetyCore::guarded(double now, Guard guard) {
  pass(now);
  guard_ = guard;
  const bool alone = guard != Guard::kNotNeeded && guard != Guard::kStands;
  if (alone && !isVented()) raise(SafetyCause::kGuardLost, -1, 0, 0);
}

const ValveOrders& SafetyCore::advance(double now) {
  pass(now);
  const double dt = now_ - turn_at_;
  turn_at_ = now_;
  // A fault is reported for at least one turn, however soon it ends.
  const bool fault = report_.state == SafetyState::kFault;
  if (report_.state == SafetyState::kEnabled) watchTimes();
  if (report_.state == SafetyState::kEnabled) regulate(dt);
  if (report_.resting) endRest();
  if (report_.state == SafetyState::kFault) endHold();
  for (int i = 0; i < count(); ++i) watch_[i].follow(now_, orders_.set_point[i], rules_);
  if (fault) endFault();
  return orders_;
}

void SafetyCore::watchTimes() {
  for (int i = 0; i < count(); ++i) {
    const double silence = watch_[i].silence(now_);
    if (silence <= rules_.reading_timeout) continue;
    raise(SafetyCause::kStaleReading, i, silence, rules_.reading_timeout);
    return;
  }
  if (rules_.min_supply && now_ - supply_at_ > rules_.reading_timeout) {
    raise(SafetyCause::kStaleReading, -1, now_ - supply_at_, rules_.reading_timeout);
  } else if (now_ - target_at_ > rules_.target_timeout) {
    raise(SafetyCause::kStaleTarget, -1, now_ - target_at_, rules_.target_timeout);
  }
}

void SafetyCore::regulate(double dt) {
  for (int i = 0; i < count(); ++i) {
    double& set_point = orders_.set_point[i];
    const double slew = channels_[i].slew;
    if (std::isinf(slew)) {
      set_point = goal_[i];
      continue;
    }
    const double step = slew * std::min(dt, kLongestStep);
    set_point = std::clamp(goal_[i], set_point - step, set_point + step);
  }
}

void SafetyCore::endHold() {
  const bool over = now_ - report_.since >= rules_.hold_time;
  for (int i = 0; i < count(); ++i) {
    // A channel is not held if its readings are missing, or if it does not hold.
    const bool unseen = watch_[i].silence(now_) > rules_.reading_timeout;
    const bool astray = orders_.valve[i] == Valve::kRegulate && watch_[i].notFollowing();
    if (over || unseen || astray) release(i);
  }
}

void SafetyCore::endFault() {
  if (allVentAndEmpty()) {
    const SafetyReport fault = report_;
    setState(SafetyState::kVented, fault.cause, fault.channel, fault.value, fault.limit);
    return;
  }
  bool overdue = false;
  for (int i = 0; i < count(); ++i) {
    overdue = overdue || (orders_.valve[i] == Valve::kVent && !watch_[i].empty(now_, rules_) &&
                          now_ - vents_since_[i] > rules_.vent_time);
  }
  if (overdue == report_.vent_overdue) return;
  report_.vent_overdue = overdue;
  ++report_.changes;
}

bool SafetyCore::allVentAndEmpty() const {
  for (int i = 0; i < count(); ++i) {
    if (orders_.valve[i] != Valve::kVent || !watch_[i].empty(now_, rules_)) return false;
  }
  return true;
}

}  // namespace helix_arm::control
