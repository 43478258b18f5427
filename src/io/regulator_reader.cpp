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

}  // namespace helix_arm::io
