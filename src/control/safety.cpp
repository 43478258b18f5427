#include "helix_arm/control/safety.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <utility>

#include "basics/text.hpp"
#include "helix_arm/basics/requirement.hpp"

namespace helix_arm::control {
namespace {

// Factor on the pressure that counts as empty: so much may still be there when noise shows a
// channel empty.
constexpr double kLeaving = 2.0;

// After a longer pause of the loop, the ramps continue with at most this step [s].
constexpr double kLongestStep = 0.1;

constexpr std::array<const char*, 4> kStateNames = {"disabled", "enabled", "fault", "vented"};
constexpr std::array<const char*, 3> kActionNames = {"vent", "hold", "close"};

struct Cause {
  const char* name;
  bool grave;   // vents every channel, whatever its action
  bool passes;  // ends as soon as messages come again
  const char* remedy;
};
constexpr std::array<Cause, kSafetyCauseCount> kCauses = {{
    {"none", false, false, "call enable"},
    {"vent_requested", true, false, "call enable to continue"},
    {"emergency_stop", true, false, "call enable"},
    {"stale_target", false, true,
     "check that the commander runs and that the network is up, then call enable"},
    {"stale_reading", false, true,
     "check the regulator's power, cable and address, then call enable"},
    // A returning regulator does not know what was held.
    {"regulator_lost", true, true, "check the regulator's power and cable, then call enable"},
    {"over_limit", true, false,
     "check for a valve that sticks or a sensor that drifts, then call enable"},
    {"low_supply", false, false, "check compressor, tank and main valve, then call enable"},
    {"not_following", false, false,
     "check for a valve that sticks, a kinked or loose tube and a supply that is too weak, then "
     "call enable"},
    {"leak", true, false, "check for a burst muscle or a loose tube, repair it, then call enable"},
    {"not_venting", true, false,
     "shut the supply and check for a valve that does not close, then call enable"},
    {"guard_lost", true, false,
     "find out what ended or stopped it (a kill, too little memory), then call enable"},
}};
static_assert(kCauses.back().name != nullptr, "each cause has a row, in the order of SafetyCause");
const Cause& rowOf(SafetyCause cause) { return kCauses[static_cast<std::size_t>(cause)]; }
bool isGrave(SafetyCause cause) { return rowOf(cause).grave; }

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

std::string tell(const std::string& what, double from, double to, const char* unit) {
  return basics::messageOf(what, " would go from ", from, " to ", to, " ", unit);
}

std::string loosened(const ChannelRules& from, const ChannelRules& to) {
  if (to.limits.upper > from.limits.upper) {
    return tell("the upper limit of " + from.name, 1e-3 * from.limits.upper, 1e-3 * to.limits.upper,
                "kPa");
  }
  // Farther below the atmosphere; or higher, to where the channel then rises without a target.
  if (to.limits.lower < std::min(0.0, from.limits.lower) ||
      to.limits.lower > std::max(0.0, from.limits.lower)) {
    return tell("the lower limit of " + from.name, 1e-3 * from.limits.lower, 1e-3 * to.limits.lower,
                "kPa");
  }
  if (to.slew > from.slew) {
    return tell("safety.slew_kpa_s", 1e-3 * from.slew, 1e-3 * to.slew, "kPa/s");
  }
  // A channel that vents is the safest, one that is closed the least safe.
  if (to.action > from.action) {
    return "safety.fault_action of " + from.name + " would go from " + nameOf(from.action) +
           " to " + nameOf(to.action);
  }
  return {};
}

using basics::format;

constexpr double kJustOver = 1.01;  // of a limit: the excess of a single turn tells nothing

std::string readingAge(const char* who, double silence) {
  if (std::isinf(silence)) return format("%s has not been read yet", who);
  return format("%s was not read for %.2f s", who, silence);
}

std::string tooOld(const char* who, double silence, double limit) {
  std::string age = readingAge(who, silence);
  if (std::isinf(silence)) return age;
  return age + format(", longer than %g s (safety.reading_timeout_s)", limit);
}

const char* remedyOf(SafetyCause cause, bool stopped) {
  if (cause == SafetyCause::kEmergencyStop && stopped) {
    return "make the arm safe, release the stop, then call enable";
  }
  return rowOf(cause).remedy;
}

}  // namespace

const char* nameOf(SafetyState state) { return kStateNames[static_cast<std::size_t>(state)]; }
const char* nameOf(SafetyCause cause) { return rowOf(cause).name; }
const char* nameOf(FaultAction action) { return kActionNames[static_cast<std::size_t>(action)]; }

void SafetyRules::validate() const {
  constexpr char kCulprit[] = "safety rules";
  basics::requireValue(target_timeout > 0, kCulprit, "target_timeout [s]", target_timeout,
                       "a value > 0");
  basics::requirePositive(kCulprit, "reading_timeout [s]", reading_timeout);
  basics::requireNotNegative(kCulprit,
                             {{"trip_margin [Pa]", trip_margin}, {"spike_time [s]", spike_time}});
  if (min_supply) basics::requirePositive(kCulprit, "min_supply [Pa]", *min_supply);
  basics::requirePositive(kCulprit, {{"follow_tolerance [Pa]", follow_tolerance},
                                     {"follow_time [s]", follow_time},
                                     {"time_constant [s]", time_constant},
                                     {"fall_time_constant [s]", fallTimeConstant()},
                                     {"leak_drop [Pa]", leak_drop}});
  basics::requireNotNegative(kCulprit, "hold_time [s]", hold_time);
  basics::requirePositive(kCulprit,
                          {{"vented_below [Pa]", vented_below}, {"vent_time [s]", vent_time}});
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
  report_.passing = report_.passing && rowOf(cause).passes;
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
  const bool overdue = overdueChannel() >= 0;
  if (overdue == report_.vent_overdue) return;
  report_.vent_overdue = overdue;
  ++report_.changes;
}

int SafetyCore::overdueChannel() const {
  for (int i = 0; i < count(); ++i) {
    if (orders_.valve[i] == Valve::kVent && !watch_[i].empty(now_, rules_) &&
        now_ - vents_since_[i] > rules_.vent_time) {
      return i;
    }
  }
  return -1;
}

bool SafetyCore::allVentAndEmpty() const {
  for (int i = 0; i < count(); ++i) {
    if (orders_.valve[i] != Valve::kVent || !watch_[i].empty(now_, rules_)) return false;
  }
  return true;
}

std::string loosened(const std::vector<ChannelRules>& channels, const SafetyRules& rules,
                     const std::vector<ChannelRules>& next_channels, const SafetyRules& next) {
  for (std::size_t i = 0; i < channels.size(); ++i) {
    std::string what = loosened(channels[i], next_channels[i]);
    if (!what.empty()) return what;
  }
  struct Rule {
    const char* key;
    double SafetyRules::*value;
    double unit;
    const char* unit_name;
  };
  // More of any of these is looser.
  static constexpr Rule kRules[] = {
      {"safety.target_timeout_s", &SafetyRules::target_timeout, 1, "s"},
      {"safety.reading_timeout_s", &SafetyRules::reading_timeout, 1, "s"},
      {"safety.trip_margin_kpa", &SafetyRules::trip_margin, 1e-3, "kPa"},
      {"safety.spike_time_s", &SafetyRules::spike_time, 1, "s"},
      {"safety.follow.tolerance_kpa", &SafetyRules::follow_tolerance, 1e-3, "kPa"},
      {"safety.follow.time_s", &SafetyRules::follow_time, 1, "s"},
      {"safety.follow.time_constant_s", &SafetyRules::time_constant, 1, "s"},
      {"safety.leak_drop_kpa", &SafetyRules::leak_drop, 1e-3, "kPa"},
      {"safety.hold_time_s", &SafetyRules::hold_time, 1, "s"},
      {"safety.vented_below_kpa", &SafetyRules::vented_below, 1e-3, "kPa"},
      {"safety.vent_time_s", &SafetyRules::vent_time, 1, "s"}};
  for (const Rule& rule : kRules) {
    if (next.*rule.value > rules.*rule.value) {
      return tell(rule.key, rule.unit * (rules.*rule.value), rule.unit * (next.*rule.value),
                  rule.unit_name);
    }
  }
  if (next.fallTimeConstant() > rules.fallTimeConstant()) {
    return tell("safety.follow.fall_time_constant_s", rules.fallTimeConstant(),
                next.fallTimeConstant(), "s");
  }
  constexpr double kNone = -std::numeric_limits<double>::infinity();
  if (next.min_supply.value_or(kNone) < rules.min_supply.value_or(kNone)) {
    return "safety.min_supply_kpa would be lower, or absent";
  }
  return {};
}

// Texts of the safety core: culprit, value, rule and remedy.

std::string SafetyCore::channelRefusal(int i, double now) const {
  const char* const name = channels_[i].name.c_str();
  const double silence = watch_[i].silence(now);
  if (!(silence <= rules_.reading_timeout)) {
    return tooOld(name, silence, rules_.reading_timeout) + "; " +
           (std::isinf(silence) ? "wait for its first reading, or " : "") +
           "check the regulator's power, cable and address";
  }
  if (watch_[i].empty(now, rules_)) return {};
  return format(
      "%s reads %.1f kPa, more than %g kPa from the atmosphere (safety.vented_below_kpa); wait for "
      "it to vent, or check for a valve that does not close",
      name, 1e-3 * watch_[i].reading(), 1e-3 * rules_.vented_below);
}

std::string SafetyCore::supplyRefusal(double now) const {
  if (!rules_.min_supply) return {};
  const double silence = now - supply_at_;
  if (!(silence <= rules_.reading_timeout)) {
    return tooOld("the supply", silence, rules_.reading_timeout) +
           "; check the regulator, or leave out safety.min_supply_kpa if it does not measure "
           "its supply";
  }
  if (supply_ >= *rules_.min_supply) return {};
  return format(
      "the supply reads %.1f kPa, less than %g kPa (safety.min_supply_kpa); check compressor, "
      "tank and main valve",
      1e-3 * supply_, 1e-3 * *rules_.min_supply);
}

std::string SafetyCore::guardRefusal() const {
  const std::string guard = "the guard, which vents the arm if this process is killed, ";
  const char* const remedy =
      "; see what it and this process have printed (a kill, a scene file that is missing or "
      "cannot be read, too little memory), then call enable";
  switch (guard_) {
    case Guard::kStarting:
      return guard + "has not answered yet; call enable again in a moment";
    case Guard::kStandsStill:
      return guard + "does not respond" + remedy;
    case Guard::kEnded:
      return guard + "has ended" + remedy;
    case Guard::kNotNeeded:
    case Guard::kStands:
      break;
  }
  return {};
}

std::string SafetyCore::refusal(double now) const {
  if (report_.state == SafetyState::kEnabled) return "it is already enabled; send targets";
  if (report_.stopped) return "the emergency stop is engaged; make the arm safe and release it";
  if (report_.state == SafetyState::kFault) return reason();
  if (!link_up_) return "the regulator's link is down; check its power and cable";
  std::string unguarded = guardRefusal();
  if (!unguarded.empty()) return unguarded;
  now = now >= now_ ? now : now_;  // as in every other call; also if it is NaN
  for (int i = 0; i < count(); ++i) {
    std::string refused = channelRefusal(i, now);
    if (!refused.empty()) return refused;
  }
  return supplyRefusal(now);
}

std::string SafetyCore::causeText() const {
  const char* const name =
      report_.channel < 0 ? "the supply" : channels_[report_.channel].name.c_str();
  const double value = report_.value, limit = report_.limit, spike = rules_.spike_time;
  switch (report_.cause) {
    case SafetyCause::kVentRequested:
      return "a vent was requested";
    case SafetyCause::kEmergencyStop:
      return "the emergency stop was engaged";
    case SafetyCause::kStaleTarget:
      if (value < kJustOver * limit) {
        return format("no target came for %g s (safety.target_timeout_s)", limit);
      }
      return format("no target came for %.2f s, longer than %g s (safety.target_timeout_s)", value,
                    limit);
    case SafetyCause::kStaleReading:
      return tooOld(name, value, limit);
    case SafetyCause::kRegulatorLost:
      return "the regulator's link went down, or orders did not reach it in time";
    case SafetyCause::kOverLimit:
      return format(
          "%s reads %.1f kPa, %s than %g kPa (its limit and safety.trip_margin_kpa) for %g s", name,
          1e-3 * value, value > limit ? "more" : "less", 1e-3 * limit, spike);
    case SafetyCause::kLowSupply:
      return format("the supply reads %.1f kPa, less than %g kPa (safety.min_supply_kpa) for %g s",
                    1e-3 * value, 1e-3 * limit, spike);
    case SafetyCause::kNotFollowing:
      return format(
          "%s is %.1f kPa from the pressure expected of its set point, more than %g kPa "
          "(safety.follow.tolerance_kpa) for %g s",
          name, 1e-3 * value, 1e-3 * limit, rules_.follow_time);
    case SafetyCause::kLeak:
      return format(
          "%s fell %.1f kPa below its constant set point, more than %g kPa "
          "(safety.leak_drop_kpa) for %g s",
          name, 1e-3 * value, 1e-3 * limit, spike);
    case SafetyCause::kNotVenting:
      return format(
          "%s reads %.1f kPa although it should be empty, more than %g kPa from the atmosphere "
          "(safety.vented_below_kpa)",
          name, 1e-3 * value, 1e-3 * limit);
    case SafetyCause::kGuardLost:
      return "the guard, which vents the arm if this process is killed, has ended or does not "
             "respond";
    case SafetyCause::kNone:
      break;
  }
  return {};
}

std::string SafetyCore::actionText() const {
  std::string held;
  int acting = 0;
  for (int i = 0; i < count(); ++i) {
    const Valve valve = orders_.valve[i];
    if (valve == Valve::kVent) continue;
    held += (acting++ ? ", " : "") + channels_[i].name +
            (valve == Valve::kClose ? " is closed" : " holds");
  }
  if (acting == 0) return ventText();
  return held + format(" for %g s (safety.hold_time_s)", rules_.hold_time) +
         (acting < count() ? ", the others vent" : "");
}

// A regulator without link has not carried out the order.
std::string SafetyCore::ventText() const {
  if (link_up_) return "all channels vent";
  return "all channels will vent as soon as the regulator can be reached; until then shut the "
         "supply and open the relief valve by hand";
}

std::string SafetyCore::overdueText() const {
  const int i = overdueChannel();
  if (!report_.vent_overdue || i < 0) return {};
  const char* const name = channels_[i].name.c_str();
  const double silence = watch_[i].silence(now_);
  return "; " +
         (silence > rules_.reading_timeout
              ? readingAge(name, silence)
              : format("%s still reads %.1f kPa", name, 1e-3 * reading_[i])) +
         format(", %.1f s after it began to vent (safety.vent_time_s is %g)",
                now_ - vents_since_[i], rules_.vent_time) +
         (link_up_ ? ": shut the supply and open the relief valve by hand" : "");
}

std::string SafetyText::line(SafetyState state) const {
  std::string out = nameOf(state);
  for (const std::string* clause : {&problem, &action}) {
    if (!clause->empty()) out += ": " + *clause;
  }
  return remedy.empty() ? out : out + "; " + remedy;
}

SafetyText SafetyCore::text() const {
  switch (report_.state) {
    case SafetyState::kEnabled:
      return {report_.resting ? "ramps down to rest" : "follows targets", "", ""};
    case SafetyState::kDisabled:
      return {rested_ ? "at rest" : "", ventText(), link_up_ ? "call enable" : ""};
    case SafetyState::kFault:
      return {causeText(), actionText() + overdueText(), remedyOf(report_.cause, report_.stopped)};
    case SafetyState::kVented:
      break;
  }
  const bool stopped_since = report_.stopped && report_.cause != SafetyCause::kEmergencyStop;
  return {"no pressure remains after " + causeText(), "",
          (stopped_since ? "release the emergency stop; " : "") +
              std::string(remedyOf(report_.cause, report_.stopped))};
}

// Rest: a commander ends without a fault.

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
