#include "safety_reader.hpp"

#include <algorithm>
#include <limits>
#include <stdexcept>

#include "helix_arm/io/number.hpp"

namespace helix_arm::io {
namespace {

constexpr double kHardwareSlew = 3e5;  // [Pa/s]

control::FaultAction actionNamed(const std::string& word) {
  for (const control::FaultAction action : control::kFaultActions) {
    if (word == control::nameOf(action)) return action;
  }
  throw std::logic_error("unknown fault action " + word);
}

std::vector<std::string> actionWords() {
  std::vector<std::string> words;
  for (const control::FaultAction action : control::kFaultActions) {
    words.emplace_back(control::nameOf(action));
  }
  return words;
}

NumberRule seconds(const NumberRule& sign) { return within(sign, 0, 3600, " s"); }

double pressure(const MapReader& keys, const char* key, double fallback) {
  return pascals(keys.number(key, kPositivePressure, kilopascals(fallback)));
}

std::optional<control::FaultAction> readAction(const MapReader& keys, const std::string& key,
                                               const std::optional<regulator::Config>& regulator) {
  const std::optional<std::string> word = keys.choice(key, actionWords());
  if (!word) return std::nullopt;
  const control::FaultAction action = actionNamed(*word);
  if (action == control::FaultAction::kClose && regulator && !regulator::closesValves(*regulator)) {
    keys.complain(key, "is close, but the valves of " + regulator::describe(*regulator) +
                           " cannot be closed; expected vent or hold");
  }
  return action;
}

// One word for all channels, or a map from actuators to words.
void readActions(const MapReader& safety, const Value& value,
                 const std::optional<regulator::Config>& regulator,
                 std::vector<control::ChannelRules>& channels, FaultList& faults) {
  if (value.kind != Value::Kind::kMap) {
    const auto action = readAction(safety, "fault_action", regulator);
    for (control::ChannelRules& channel : channels)
      channel.action = action.value_or(channel.action);
    return;
  }
  if (channels.empty()) return;  // the arm has faults or no pressures
  std::vector<std::string> names;
  for (const control::ChannelRules& channel : channels) names.push_back(channel.name);
  const MapReader actions(value, safety.path("fault_action"), names, faults);
  for (control::ChannelRules& channel : channels) {
    if (!actions.has(channel.name)) continue;
    channel.action = readAction(actions, channel.name, regulator).value_or(channel.action);
  }
}

void readFollow(const Value& value, const std::string& path, control::SafetyRules& rules,
                FaultList& faults) {
  const MapReader follow(
      value, path, {"tolerance_kpa", "time_s", "time_constant_s", "fall_time_constant_s"}, faults);
  rules.follow_tolerance = pressure(follow, "tolerance_kpa", rules.follow_tolerance);
  rules.follow_time = follow.number("time_s", seconds(kPositive), rules.follow_time);
  rules.time_constant = follow.number("time_constant_s", seconds(kPositive), rules.time_constant);
  rules.fall_time_constant = follow.optionalNumber("fall_time_constant_s", seconds(kPositive));
}

void readTargetTimeout(const MapReader& safety, bool simulated, control::SafetyRules& rules) {
  const double timeout =
      safety.number("target_timeout_s", seconds(kNotNegative), rules.target_timeout);
  if (timeout == 0 && !simulated) {
    safety.fault(
        "target_timeout_s",
        "a finite value > 0: only a simulated regulator may wait for targets without limit");
  }
  rules.target_timeout = timeout > 0 ? timeout : std::numeric_limits<double>::infinity();
}

std::vector<control::ChannelRules> channelsOf(const ArmParts* arm) {
  std::vector<control::ChannelRules> channels;
  for (int i = 0; arm != nullptr && i < arm->arm.actuatorCount(); ++i) {
    const model::Actuator& actuator = arm->arm.actuator(i);
    if (!model::isPressure(actuator.drive)) return {};
    channels.push_back({actuator.name, actuator.limits});
  }
  return channels;
}

// A pressure beyond a limit must not count as vented.
void checkVentedBelow(const MapReader& safety, const SafetyConfig& config) {
  for (const control::ChannelRules& channel : config.channels) {
    const double nearest = std::min(control::highestReading(channel, config.rules),
                                    -control::lowestReading(channel, config.rules));
    if (config.rules.vented_below < nearest) continue;
    const std::string expected = "less than " + formatNumber(kilopascals(nearest)) + ", where " +
                                 channel.name + " is beyond its limits by " +
                                 safety.path("trip_margin_kpa");
    if (safety.has("vented_below_kpa")) {
      safety.fault("vented_below_kpa", expected);
    } else {
      safety.complain("vented_below_kpa", "is " +
                                              formatNumber(kilopascals(config.rules.vented_below)) +
                                              " by default; expected " + expected);
    }
    return;
  }
}

}  // namespace

SafetyConfig readSafety(const MapReader& scene, const Value& document, const ArmParts* arm,
                        const std::optional<regulator::Config>& regulator, FaultList& faults) {
  SafetyConfig config;
  config.channels = channelsOf(arm);
  const bool hardware = regulator && regulator::isHardware(*regulator);
  const auto setSlew = [&config](double slew) {
    for (control::ChannelRules& channel : config.channels) channel.slew = slew;
  };
  if (hardware) setSlew(kHardwareSlew);
  const Value* value = document.find("safety");
  if (value == nullptr) return config;
  const std::size_t before = faults.count();
  const MapReader safety(
      *value, scene.path("safety"),
      {"commander_timeout_s", "target_timeout_s", "reading_timeout_s", "slew_kpa_s",
       "trip_margin_kpa", "spike_time_s", "min_supply_kpa", "follow", "leak_drop_kpa",
       "fault_action", "hold_time_s", "vented_below_kpa", "vent_time_s"},
      faults);
  control::SafetyRules& rules = config.rules;
  config.commander_timeout =
      safety.number("commander_timeout_s", kPositive, config.commander_timeout);
  // A regulator that was given but has faults is not also reported as unknown.
  const bool unknown = !regulator && document.find("regulator") != nullptr;
  readTargetTimeout(safety, unknown || (regulator && !hardware), rules);
  rules.reading_timeout =
      safety.number("reading_timeout_s", seconds(kPositive), rules.reading_timeout);
  if (const auto slew =
          safety.optionalNumber("slew_kpa_s", within(kPositive, 1e-3, 1e6, " kPa/s"))) {
    setSlew(pascals(*slew));
  }
  rules.trip_margin = pascals(safety.number("trip_margin_kpa", within(kNotNegative, 0, 1e5, " kPa"),
                                            kilopascals(rules.trip_margin)));
  rules.spike_time = safety.number("spike_time_s", seconds(kNotNegative), rules.spike_time);
  if (const auto least = safety.optionalNumber("min_supply_kpa", kPositivePressure)) {
    rules.min_supply = pascals(*least);
  }
  if (const Value* follow = value->find("follow")) {
    readFollow(*follow, safety.path("follow"), rules, faults);
  }
  rules.leak_drop = pressure(safety, "leak_drop_kpa", rules.leak_drop);
  if (const Value* actions = value->find("fault_action")) {
    readActions(safety, *actions, regulator, config.channels, faults);
  }
  rules.hold_time = safety.number("hold_time_s", seconds(kNotNegative), rules.hold_time);
  rules.vented_below = pressure(safety, "vented_below_kpa", rules.vented_below);
  rules.vent_time = safety.number("vent_time_s", seconds(kPositive), rules.vent_time);
  if (faults.count() == before) checkVentedBelow(safety, config);
  return config;
}

}  // namespace helix_arm::io
