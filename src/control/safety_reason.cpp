#include <algorithm>
#include <cmath>
#include <cstdio>

#include "helix_arm/control/safety.hpp"

// Texts of the safety core: culprit, value, rule and remedy.

namespace helix_arm::control {
namespace {

constexpr double kJustOver = 1.01;  // of a limit: the excess of a single turn tells nothing

template <class... Arguments>
std::string format(const char* pattern, Arguments... arguments) {
  char text[400];
  std::snprintf(text, sizeof text, pattern, arguments...);
  return text;
}

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
  switch (cause) {
    case SafetyCause::kVentRequested:
      return "call enable to continue";
    case SafetyCause::kEmergencyStop:
      return stopped ? "make the arm safe, release the stop, then call enable" : "call enable";
    case SafetyCause::kStaleTarget:
      return "check that the commander runs and that the network is up, then call enable";
    case SafetyCause::kStaleReading:
      return "check the regulator's power, cable and address, then call enable";
    case SafetyCause::kRegulatorLost:
      return "check the regulator's power and cable, then call enable";
    case SafetyCause::kOverLimit:
      return "check for a valve that sticks or a sensor that drifts, then call enable";
    case SafetyCause::kLowSupply:
      return "check compressor, tank and main valve, then call enable";
    case SafetyCause::kNotFollowing:
      return "check for a valve that sticks, a kinked or loose tube and a supply that is too weak, "
             "then call enable";
    case SafetyCause::kLeak:
      return "check for a burst muscle or a loose tube, repair it, then call enable";
    case SafetyCause::kNotVenting:
      return "shut the supply and check for a valve that does not close, then call enable";
    case SafetyCause::kGuardLost:
      return "find out what ended or stopped it (a kill, too little memory), then call enable";
    case SafetyCause::kNone:
      break;
  }
  return "call enable";
}

}  // namespace

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
          "%s reads %.1f kPa, %s than %g kPa (its limit and safety.trip_margin_kpa) for "
          "%g s",
          name, 1e-3 * value, value > limit ? "more" : "less", 1e-3 * limit, spike);
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
  if (!report_.vent_overdue) return {};
  for (int i = 0; i < count(); ++i) {
    const bool due = now_ - vents_since_[i] > rules_.vent_time;
    if (orders_.valve[i] != Valve::kVent || watch_[i].empty(now_, rules_) || !due) continue;
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
  return {};
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

}  // namespace helix_arm::control
