#include <algorithm>
#include <limits>
#include <sstream>

#include "helix_arm/control/safety.hpp"

namespace helix_arm::control {
namespace {

std::string tell(const std::string& what, double from, double to, const char* unit) {
  std::ostringstream text;
  text << what << " would go from " << from << " to " << to << " " << unit;
  return text.str();
}

// A channel that vents is the safest, one that is closed the least safe.
int risk(FaultAction action) { return static_cast<int>(action); }

std::string loosened(const ChannelRules& from, const ChannelRules& to) {
  if (to.limits.upper > from.limits.upper) {
    return tell("the upper limit of " + from.name, 1e-3 * from.limits.upper, 1e-3 * to.limits.upper,
                "kPa");
  }
  // Farther below the atmosphere; or a higher lower limit, to which the channel rises without a
  // target once it is enabled.
  if (to.limits.lower < std::min(0.0, from.limits.lower) ||
      to.limits.lower > std::max(0.0, from.limits.lower)) {
    return tell("the lower limit of " + from.name, 1e-3 * from.limits.lower, 1e-3 * to.limits.lower,
                "kPa");
  }
  if (to.slew > from.slew) {
    return tell("safety.slew_kpa_s", 1e-3 * from.slew, 1e-3 * to.slew, "kPa/s");
  }
  if (risk(to.action) > risk(from.action)) {
    return "safety.fault_action of " + from.name + " would go from " + nameOf(from.action) +
           " to " + nameOf(to.action);
  }
  return {};
}

}  // namespace

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

}  // namespace helix_arm::control
