#include "regulator_reader.hpp"

#include <algorithm>
#include <iterator>
#include <limits>
#include <numeric>
#include <set>
#include <stdexcept>

#include "helix_arm/io/number.hpp"
#include "profile_file.hpp"

namespace helix_arm::io {
namespace {

constexpr int kMostSlots = 1024;
const NumberRule kDeadTime = within(kNotNegative, 0, 1, " s");

std::optional<regulator::Config> readSimulated(const Value& value, const std::string& path,
                                               const ArmParts*, FaultList& faults) {
  const MapReader keys(
      value, path,
      {"time_constant_s", "fall_time_constant_s", "dead_time_s", "supply_kpa", "noise_kpa", "seed"},
      faults);
  regulator::SimulatedRegulatorConfig config;
  config.time_constant = keys.number("time_constant_s", kPositive, config.time_constant);
  config.fall_time_constant = keys.optionalNumber("fall_time_constant_s", kPositive);
  config.dead_time = keys.number("dead_time_s", kDeadTime, config.dead_time);
  config.supply_pressure =
      pascals(keys.number("supply_kpa", kPositivePressure, config.supply_pressure / 1e3));
  config.noise = pascals(keys.number("noise_kpa", kNotNegative, config.noise / 1e3));
  config.seed = static_cast<std::uint32_t>(
      keys.integer("seed", 0, std::numeric_limits<std::uint32_t>::max(), config.seed));
  return config;
}

std::string channels(const ArmParts& arm) {
  return std::to_string(arm.arm.actuatorCount()) + " entries, one per actuator";
}

// One distinct word per channel.
std::vector<std::string> readAddresses(const MapReader& keys, const Value& value,
                                       const ArmParts* arm, FaultList& faults) {
  const std::string path = keys.path("addresses");
  std::vector<std::string> addresses;
  std::set<std::string> seen;
  if (value.kind != Value::Kind::kList) {
    keys.fault("addresses", "a list of words, one per actuator");
    return addresses;
  }
  for (std::size_t i = 0; i < value.entries.size(); ++i) {
    const Value& entry = value.entries[i].value;
    const auto complain = [&](const std::string& expected) {
      report(faults, entry.place,
             indexPath(path, i) + " is " + entry.describe() + "; expected " + expected);
    };
    const bool word = entry.kind == Value::Kind::kText && !entry.text.empty() &&
                      std::all_of(entry.text.begin(), entry.text.end(),
                                  [](char c) { return c > ' ' && c <= '~'; });
    if (!word) {
      complain("a word without spaces");
    } else if (!seen.insert(entry.text).second) {
      complain("one that no other actuator has");
    }
    addresses.push_back(entry.text);
  }
  const bool right_size =
      arm == nullptr || static_cast<int>(addresses.size()) == arm->arm.actuatorCount();
  if (!right_size) {
    keys.complain("addresses", "has " + std::to_string(addresses.size()) + " entries; expected " +
                                   channels(*arm));
  }
  return addresses;
}

std::optional<regulator::Config> readSerial(const Value& value, const std::string& path,
                                            const ArmParts* arm, FaultList& faults) {
  const MapReader keys(value, path, {"profile", "device", "addresses"}, faults);
  const std::optional<regulator::SerialProfile> profile = readSerialProfileFile(keys, faults);
  const std::optional<std::string> device = keys.text("device", "a serial port like /dev/ttyUSB0");
  const Value* given = value.find("addresses");
  regulator::SerialConfig config;
  if (given != nullptr) config.addresses = readAddresses(keys, *given, arm, faults);
  const bool addressed = profile && profile->write.find("{address}") != std::string::npos;
  if (addressed && given == nullptr) {
    keys.complain("addresses", "is missing; profile " + profile->name +
                                   " addresses each channel: expected " +
                                   (arm == nullptr ? "one per actuator" : channels(*arm)));
  } else if (profile && !addressed && given != nullptr) {
    keys.complain("addresses", "is not used: the lines of profile " + profile->name +
                                   " have no {address}; expected none");
  }
  if (!profile || !device) return std::nullopt;
  config.profile = *profile;
  config.device = *device;
  return config;
}

std::vector<int> readSlots(const MapReader& keys, const ArmParts* arm) {
  const std::size_t count = arm == nullptr ? 0 : arm->arm.actuatorCount();
  std::vector<int> slots(count);
  std::iota(slots.begin(), slots.end(), 0);
  if (!keys.has("slots")) return slots;
  const auto given = keys.numbers("slots", count, within(kNotNegative, 0, kMostSlots - 1));
  if (!given) return slots;
  slots.assign(given->begin(), given->end());
  const std::set<double> different(given->begin(), given->end());
  const bool whole = std::equal(slots.begin(), slots.end(), given->begin());
  if (!whole || different.size() != given->size()) {
    keys.fault("slots", "distinct whole numbers");
  }
  return slots;
}

// The device must accept the limits of the arm: pressures are written as counts from 0 on.
void checkRange(const MapReader& keys, const regulator::ModbusProfile& profile,
                const ArmParts& arm) {
  const model::Range takes{0 - profile.atmosphere,
                           profile.highest_count * profile.pascals - profile.atmosphere};
  for (int i = 0; i < arm.arm.actuatorCount(); ++i) {
    const model::Actuator& actuator = arm.arm.actuator(i);
    const model::Range& limits = actuator.limits;
    if (!model::isPressure(actuator.drive)) continue;
    if (takes.contains(limits.lower) && takes.contains(limits.upper)) continue;
    keys.complain("profile", "is " + profile.name + ", which accepts " +
                                 formatNumber(kilopascals(takes.lower)) + " to " +
                                 formatNumber(kilopascals(takes.upper)) +
                                 " kPa; expected limits within that, not " + actuator.name +
                                 "'s of " + formatNumber(kilopascals(limits.lower)) + " to " +
                                 formatNumber(kilopascals(limits.upper)) + " kPa");
  }
}

std::optional<regulator::Config> readModbus(const Value& value, const std::string& path,
                                            const ArmParts* arm, FaultList& faults) {
  const MapReader keys(value, path, {"profile", "host", "port", "slots"}, faults);
  const std::optional<regulator::ModbusProfile> profile = readModbusProfileFile(keys, faults);
  const std::optional<std::string> host = keys.text("host", "a name or address");
  regulator::ModbusConfig config;
  config.port = static_cast<int>(keys.integer("port", 1, 65535, config.port));
  config.slots = readSlots(keys, arm);
  if (profile && arm != nullptr) checkRange(keys, *profile, *arm);
  if (!profile || !host) return std::nullopt;
  config.profile = *profile;
  config.host = *host;
  return config;
}

// A kind of regulator below `regulator`, with its reader.
struct RegulatorKind {
  const char* key;
  std::optional<regulator::Config> (*read)(const Value& value, const std::string& path,
                                           const ArmParts* arm, FaultList& faults);
};
constexpr RegulatorKind kKinds[] = {
    {"simulated", readSimulated}, {"ascii_serial", readSerial}, {"modbus_tcp", readModbus}};

}  // namespace

std::optional<regulator::Config> readRegulator(const MapReader& scene, const Value& document,
                                               const ArmParts* arm, FaultList& faults) {
  const Value* value = document.find("regulator");
  if (value == nullptr) return std::nullopt;
  std::vector<std::string> keys;
  for (const RegulatorKind& known : kKinds) keys.emplace_back(known.key);
  const MapReader regulator(*value, scene.path("regulator"), keys, faults);
  const std::optional<std::string> kind = regulator.exactlyOne(keys);
  if (!kind) return std::nullopt;
  const RegulatorKind& known = *std::find_if(std::begin(kKinds), std::end(kKinds),
                                             [&](const auto& one) { return *kind == one.key; });
  const std::size_t before = faults.count();
  for (int i = 0; arm != nullptr && i < arm->arm.actuatorCount(); ++i) {
    const model::Actuator& actuator = arm->arm.actuator(i);
    if (model::isPressure(actuator.drive)) continue;
    regulator.complain(*kind,
                       "regulates pressures, but " + actuator.name +
                           " is a tendon; expected an arm of pressure actuators or no regulator");
  }
  std::optional<regulator::Config> config =
      known.read(*value->find(*kind), regulator.path(*kind), arm, faults);
  if (!config || arm == nullptr || faults.count() != before) return std::nullopt;
  try {
    regulator::makeDriver(*config,
                          arm->arm.actuatorCount());  // constructed for its checks, not connected
  } catch (const std::invalid_argument& error) {
    regulator.complain(*kind, std::string("cannot be used: ") + error.what());
  }
  return config;
}

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
