#include <algorithm>
#include <cmath>
#include <iterator>
#include <limits>
#include <numeric>
#include <set>
#include <stdexcept>

#include "helix_arm/io/number.hpp"
#include "scene_readers.hpp"

namespace helix_arm::io {
namespace {

constexpr int kMostSlots = 1024;

using RegulatorReader = std::optional<regulator::Config>(const MapReader& regulator,
                                                         const std::string& kind,
                                                         const ArmParts* arm);

std::optional<regulator::Config> readSimulated(const MapReader& regulator, const std::string& kind,
                                               const ArmParts*) {
  regulator::SimulatedRegulatorConfig config;
  regulator.map(kind, {{"time_constant_s", kPositive, config.time_constant},
                       {"fall_time_constant_s", kPositive, config.fall_time_constant},
                       {"dead_time_s", within(kNotNegative, 0, 1, " s"), config.dead_time},
                       {"supply_kpa", kPositivePressure, config.supply_pressure, kKilo},
                       {"noise_kpa", kNotNegative, config.noise, kKilo},
                       {"seed", kSeed, config.seed}});
  return config;
}

std::string perActuator(const ArmParts& arm) {
  return std::to_string(arm.arm.actuatorCount()) + " entries, one per actuator";
}

// One distinct word per channel.
std::vector<std::string> readAddresses(const MapReader& keys, const ArmParts* arm) {
  std::vector<std::string> addresses;
  std::set<std::string> seen;
  if (!keys.isList("addresses")) {
    keys.fault("addresses", "a list of words, one per actuator");
    return addresses;
  }
  for (const auto& [none, entry] : keys.find("addresses")->entries) {
    const auto complain = [&, &value = entry](const std::string& expected) {
      report(keys.faults(), value.place,
             indexPath(keys.path("addresses"), addresses.size()) + " is " + value.describe() +
                 "; expected " + expected);
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
  if (arm != nullptr && static_cast<int>(addresses.size()) != arm->arm.actuatorCount()) {
    keys.complainOfSize("addresses", addresses.size(), perActuator(*arm));
  }
  return addresses;
}

std::optional<regulator::Config> readSerial(const MapReader& regulator, const std::string& kind,
                                            const ArmParts* arm) {
  const MapReader keys = *regulator.map(kind, {"profile", "device", "addresses"});
  const auto file = readProfileFile(keys, kind);
  const auto* profile = file ? std::get_if<regulator::SerialProfile>(&*file) : nullptr;
  const auto device = keys.read("device", Text{"a serial port like /dev/ttyUSB0"});
  regulator::SerialConfig config;
  const bool given = keys.has("addresses");
  if (given) config.addresses = readAddresses(keys, arm);
  const bool addressed =
      profile != nullptr && profile->write.find("{address}") != std::string::npos;
  if (addressed && !given) {
    keys.complain("addresses", "is missing; profile " + profile->name +
                                   " addresses each channel: expected " +
                                   (arm == nullptr ? "one per actuator" : perActuator(*arm)));
  } else if (profile && !addressed && given) {
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
  std::vector<double> slots(count);
  std::iota(slots.begin(), slots.end(), 0);
  Key("slots", Numbers{within(kNotNegative, 0, kMostSlots - 1), count}, slots).read(keys);
  const bool whole =
      std::all_of(slots.begin(), slots.end(), [](double slot) { return slot == std::floor(slot); });
  if (!whole || std::set<double>(slots.begin(), slots.end()).size() != slots.size()) {
    keys.fault("slots", "distinct whole numbers");
  }
  return {slots.begin(), slots.end()};
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

std::optional<regulator::Config> readModbus(const MapReader& regulator, const std::string& kind,
                                            const ArmParts* arm) {
  regulator::ModbusConfig config;
  const MapReader keys =
      *regulator.map(kind, {"profile", "host", {"port", Whole{1, 65535}, config.port}, "slots"});
  const auto file = readProfileFile(keys, kind);
  const auto* profile = file ? std::get_if<regulator::ModbusProfile>(&*file) : nullptr;
  const std::optional<std::string> host = keys.read("host", Text{"a name or address"});
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
  RegulatorReader* read;
};
constexpr RegulatorKind kKinds[] = {
    {"simulated", readSimulated}, {"ascii_serial", readSerial}, {"modbus_tcp", readModbus}};

constexpr double kHardwareSlew = 3e5;  // [Pa/s]

constexpr NumberRule seconds(const NumberRule& sign) { return within(sign, 0, 3600, " s"); }

void readAction(const MapReader& keys, const std::string& key,
                const std::optional<regulator::Config>& regulator, control::FaultAction& action) {
  Key(key.c_str(), oneOfNamed(control::kFaultActions), action).read(keys);
  if (action == control::FaultAction::kClose && regulator && !regulator::closesValves(*regulator)) {
    keys.complain(key, "is close, but the valves of " + regulator::describe(*regulator) +
                           " cannot be closed; expected vent or hold");
  }
}

// One word for all channels, or a map from actuators to words.
void readActions(const MapReader& safety, const std::string& key,
                 const std::optional<regulator::Config>& regulator,
                 std::vector<control::ChannelRules>& channels) {
  if (safety.find(key)->kind != Value::Kind::kMap) {
    control::FaultAction action = control::ChannelRules().action;
    readAction(safety, key, regulator, action);
    for (control::ChannelRules& channel : channels) channel.action = action;
    return;
  }
  if (channels.empty()) return;  // the arm has faults or no pressures
  std::vector<std::string> names;
  for (const control::ChannelRules& channel : channels) names.push_back(channel.name);
  const MapReader actions = *safety.map(key, keysOf(names));
  for (control::ChannelRules& channel : channels) {
    if (actions.has(channel.name)) readAction(actions, channel.name, regulator, channel.action);
  }
}

void setTargetTimeout(const MapReader& safety, bool simulated, double& timeout) {
  if (timeout == 0 && !simulated) {
    safety.fault(
        "target_timeout_s",
        "a finite value > 0: only a simulated regulator may wait for targets without limit");
  }
  if (timeout <= 0) timeout = std::numeric_limits<double>::infinity();
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

std::optional<regulator::Config> readRegulator(const MapReader& scene, const ArmParts* arm) {
  std::vector<std::string> kinds;
  for (const RegulatorKind& known : kKinds) kinds.emplace_back(known.key);
  const std::optional<MapReader> regulator = scene.map("regulator", keysOf(kinds));
  if (!regulator) return std::nullopt;
  const std::optional<std::size_t> given = regulator->exactlyOne(kinds);
  if (!given) return std::nullopt;
  const std::string& kind = kinds[*given];
  for (int i = 0; arm != nullptr && i < arm->arm.actuatorCount(); ++i) {
    const model::Actuator& actuator = arm->arm.actuator(i);
    if (model::isPressure(actuator.drive)) continue;
    regulator->complain(kind,
                        "regulates pressures, but " + actuator.name +
                            " is a tendon; expected an arm of pressure actuators or no regulator");
  }
  std::optional<regulator::Config> config = kKinds[*given].read(*regulator, kind, arm);
  if (!config || arm == nullptr || !regulator->isSound()) return std::nullopt;
  try {
    regulator::makeDriver(*config,
                          arm->arm.actuatorCount());  // constructed for its checks, not connected
  } catch (const std::invalid_argument& error) {
    regulator->complain(kind, std::string("cannot be used: ") + error.what());
  }
  return config;
}

SafetyConfig readSafety(const MapReader& scene, const ArmParts* arm,
                        const std::optional<regulator::Config>& regulator) {
  SafetyConfig config;
  config.channels = channelsOf(arm);
  control::SafetyRules& rules = config.rules;
  const bool hardware = regulator && regulator::isHardware(*regulator);
  std::optional<double> slew;
  if (hardware) slew = kHardwareSlew;
  const auto safety = scene.map(
      "safety",
      {{"commander_timeout_s", kPositive, config.commander_timeout},
       {"target_timeout_s", seconds(kNotNegative), rules.target_timeout},
       {"reading_timeout_s", seconds(kPositive), rules.reading_timeout},
       {"slew_kpa_s", within(kPositive, 1e-3, 1e6, " kPa/s"), slew, kKilo},
       {"trip_margin_kpa", within(kNotNegative, 0, 1e5, " kPa"), rules.trip_margin, kKilo},
       {"spike_time_s", seconds(kNotNegative), rules.spike_time},
       {"min_supply_kpa", kPositivePressure, rules.min_supply, kKilo},
       {"follow",
        {{"tolerance_kpa", kPositivePressure, rules.follow_tolerance, kKilo},
         {"time_s", seconds(kPositive), rules.follow_time},
         {"time_constant_s", seconds(kPositive), rules.time_constant},
         {"fall_time_constant_s", seconds(kPositive), rules.fall_time_constant}}},
       {"leak_drop_kpa", kPositivePressure, rules.leak_drop, kKilo},
       {"fault_action",
        [&](const MapReader& keys, const std::string& key) {
          readActions(keys, key, regulator, config.channels);
        }},
       {"hold_time_s", seconds(kNotNegative), rules.hold_time},
       {"vented_below_kpa", kPositivePressure, rules.vented_below, kKilo},
       {"vent_time_s", seconds(kPositive), rules.vent_time}});
  for (control::ChannelRules& channel : config.channels) channel.slew = slew.value_or(channel.slew);
  if (!safety) return config;
  // A regulator that was given but has faults is not also reported as unknown.
  const bool unknown = !regulator && scene.has("regulator");
  setTargetTimeout(*safety, unknown || (regulator && !hardware), rules.target_timeout);
  if (safety->isSound()) checkVentedBelow(*safety, config);
  return config;
}

}  // namespace helix_arm::io
