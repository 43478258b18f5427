#include <algorithm>
#include <cmath>
#include <cstddef>
#include <filesystem>
#include <iterator>
#include <limits>
#include <numeric>
#include <stdexcept>

#include "basics/quote.hpp"
#include "helix_arm/basics/requirement.hpp"
#include "helix_arm/io/fault_list.hpp"
#include "io/document/number.hpp"
#include "scene_readers.hpp"
#include "shipped_files.hpp"

namespace helix_arm::io {
namespace {

constexpr NumberRule kAtmosphere = within(kNotNegative, 0, 200, " kPa");
constexpr NumberRule kTimeout = within(kPositive, 1e-3, 10, " s");
constexpr Whole kChannels{1, 1024};

// The row of one line, or of a list of them.
Key linesKey(const char* name, std::vector<std::string>& lines) {
  return {name, [&lines](const MapReader& keys, const std::string& key) {
            if (!keys.isList(key)) {
              const auto line = keys.read(key, Text{"a line of text, or a list of them"});
              if (line) lines.push_back(*line);
              return;
            }
            const std::vector<Value::Entry>& entries = keys.find(key)->entries;
            for (std::size_t i = 0; i < entries.size(); ++i) {
              const Value& entry = entries[i].value;
              lines.push_back(entry.text);
              if (entry.kind == Value::Kind::kText && !entry.text.empty()) continue;
              report(keys.faults(), entry.place, indexPath(keys.path(key), i), " is ",
                     entry.describe(), "; expected a line of text");
            }
          }};
}

constexpr Whole kRegister{0, 0xffff};
constexpr Whole kStride{1, 1024};
constexpr Whole kInStride{0, kStride.highest - 1};

std::vector<Key> appKeys(regulator::ModbusApp& app) {
  return {Key("command", kInStride, app.command).required(),
          Key("regulate", kRegister, app.regulate).required(),
          Key("off", kRegister, app.off).required(),
          Key("acknowledge", kRegister, app.acknowledge).required(),
          Key("status", kInStride, app.status).required(),
          {"status_mask", Whole{1, kRegister.highest}, app.status_mask},
          Key("ready", kRegister, app.ready).required(),
          Key("running", kRegister, app.running).required(),
          {"activation_time_s", within(kPositive, 0.01, 60, " s"), app.activation_time}};
}

MapReader readSerialProfile(const Value& map, regulator::SerialProfile& profile,
                            FaultList& faults) {
  constexpr Text kLine{"a line of text"}, kSeparator{"the separator of numbers"};
  const OneOf<std::string> kTerminator{{{"cr", "\r"}, {"lf", "\n"}, {"crlf", "\r\n"}}};
  const OneOf<double> kUnit{
      {{"psi", regulator::kPsi}, {"kPa", 1e3}, {"bar", 1e5}, {"mbar", 100}, {"Pa", 1}}};
  double scale = 1.0;
  MapReader keys(map, regulator::SerialConfig::kKind,
                 {{"baud", Whole{1200, 2000000}, profile.baud},
                  Key("terminator", kTerminator, profile.terminator).required(),
                  Key("unit", kUnit, profile.pascals).required(),
                  {"scale", within(kPositive, 1e-6, 1e6), scale},
                  {"atmosphere_kpa", kAtmosphere, profile.atmosphere, kKilo},
                  {"unit_word", Text{"a word"}, profile.unit_word},
                  {"decimals", Whole{0, 6}, profile.decimals},
                  {"separator", kSeparator, profile.separator},
                  {"reply_separator", kSeparator, profile.reply_separator},
                  {"one_by_one", profile.one_by_one},
                  linesKey("start", profile.start),
                  {"unit_query", kLine, profile.unit_query},
                  {"unit_reply", kLine, profile.unit_reply},
                  Key("write", kLine, profile.write).required(),
                  {"write_reply", kLine, profile.write_reply},
                  {"read", kLine, profile.read},
                  Key("reply", kLine, profile.reply).required(),
                  {"supply_line", kLine, profile.supply_line},
                  linesKey("skip", profile.skip),
                  linesKey("vent", profile.vent).required(),
                  linesKey("close", profile.close),
                  linesKey("resume", profile.resume),
                  {"vent_reply", kLine, profile.vent_reply},
                  {"timeout_s", kTimeout, profile.timeout},
                  {"watchdog_s", within(kPositive, 0.1, 60, " s"), profile.watchdog},
                  {"highest_kpa", within(kPositive, 1e-3, 1e5, " kPa"), profile.highest, kKilo},
                  {"channels", kChannels, profile.channels},
                  {"checksum", OneOf<bool>{{{"none", false}, {"crc16", true}}}, profile.checksum}},
                 faults);
  profile.pascals *= scale;
  if (!keys.has("reply_separator")) profile.reply_separator = profile.separator;
  return keys;
}

MapReader readModbusProfile(const Value& map, regulator::ModbusProfile& profile,
                            FaultList& faults) {
  regulator::ModbusApp app;
  const OneOf<bool> kRegisters{{{"holding", false}, {"input", true}}};
  MapReader keys(map, regulator::ModbusConfig::kKind,
                 {{"unit_id", Whole{0, 255}, profile.unit_id},
                  Key("count_pa", within(kPositive, 1e-3, 1e6, " Pa"), profile.pascals).required(),
                  {"atmosphere_kpa", kAtmosphere, profile.atmosphere, kKilo},
                  Key("highest_count", Whole{1, 32767}, profile.highest_count).required(),
                  {"outlets", Whole{1, 64}, profile.outlets},
                  {"channels", kChannels, profile.channels},
                  {"outputs",
                   {Key("first", kRegister, profile.output_base).required(),
                    Key("stride", kStride, profile.output_stride).required(),
                    Key("pressure", kInStride, profile.output_pressure).required()}},
                  {"inputs",
                   {Key("first", kRegister, profile.input_base).required(),
                    Key("stride", kStride, profile.input_stride).required(),
                    Key("pressure", kInStride, profile.input_pressure).required(),
                    Key("registers", kRegisters, profile.input_registers).required()}},
                  {"supply", kRegister, profile.supply},
                  {"app", appKeys(app)},
                  {"timeout_s", kTimeout, profile.timeout}},
                 faults);
  keys.required("outputs", "a map of first, stride and pressure");
  keys.required("inputs", "a map of first, stride, pressure and registers");
  if (keys.has("app")) profile.app = app;
  return keys;
}

// The profile that a map holds, of the kind with this key.
using ProfileReader = std::optional<regulator::Profile>(const Value& map, const std::string& kind,
                                                        const std::string& name, FaultList& faults);

template <class Profile, MapReader (*read)(const Value&, Profile&, FaultList&)>
std::optional<regulator::Profile> checked(const Value& map, const std::string& kind,
                                          const std::string& name, FaultList& faults) {
  Profile profile;
  profile.name = name;
  if (!read(map, profile, faults).isSound()) return std::nullopt;
  try {
    profile.validate();
    return profile;
  } catch (const std::invalid_argument& error) {
    report(faults, map.place, kind + ": " + error.what());
    return std::nullopt;
  }
}

std::vector<std::string> profileKinds();

namespace fs = std::filesystem;

constexpr std::size_t kLongestProfile = 200;  // of a path, in a message

fs::path pathOf(const std::string& profile) {
  return isProfilePath(profile) ? fs::path(profile)
                                : fs::path(shippedFolder(kShippedRegulators)) / (profile + ".yaml");
}

bool isKnown(const std::string& profile, const std::vector<std::string>& shipped) {
  return isProfilePath(profile) ||
         std::find(shipped.begin(), shipped.end(), profile) != shipped.end();
}

// The value of a key; null without a map or without the key.
Value* child(Value* map, const char* key) {
  return map == nullptr ? nullptr : findValue(*map, key);
}

// Content of a profile file, whose kind has to be `kind` unless that is null.
std::optional<regulator::Profile> readContent(const fs::path& path, const char* kind,
                                              FaultList& faults) {
  const std::optional<std::string> text = readTextFile(path, kMostSceneBytes, faults);
  if (!text) return std::nullopt;
  const std::optional<Value> document =
      parseDocument(*text, {profileKinds(), profileKinds(), 1}, faults);
  if (!document) return std::nullopt;
  auto profile = readProfile(*document, kind, path.stem(), faults);
  return faults.empty() ? std::move(profile) : std::nullopt;
}

// The profile that the key `profile` of a kind of regulator names: shipped, or a path. Faults in it
// are reported with its own file and lines; nothing then, or if it is of another kind.
std::optional<regulator::Profile> readProfileFile(const MapReader& keys, const std::string& kind) {
  const std::vector<std::string> shipped = shippedProfiles();
  const std::string expected =
      alternatives(shipped) + ", or a path (with a / or ending in .yaml) from the scene's folder";
  const std::optional<std::string> profile = keys.read("profile", Text{expected.c_str()});
  if (!profile) return std::nullopt;
  if (!isKnown(*profile, shipped)) {
    keys.fault("profile", expected);
    return std::nullopt;
  }
  const fs::path path = pathOf(*profile);
  FaultList in_file(path.string());
  std::optional<regulator::Profile> read = readContent(path, kind.c_str(), in_file);
  if (!in_file.empty()) {
    keys.complain("profile", "is ", basics::quoted(*profile, kLongestProfile),
                  ", which has faults:");
  }
  keys.faults().append(in_file);
  return read;
}

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
      report(keys.faults(), value.place, indexPath(keys.path("addresses"), addresses.size()),
             " is ", value.describe(), "; expected ", expected);
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
    keys.complain("addresses", "is missing; profile ", profile->name,
                  " addresses each channel: expected ",
                  arm == nullptr ? "one per actuator" : perActuator(*arm));
  } else if (profile && !addressed && given) {
    keys.complain("addresses", "is not used: the lines of profile ", profile->name,
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
    keys.complain("profile", "is ", profile.name, ", which accepts ",
                  formatNumber(kilopascals(takes.lower)), " to ",
                  formatNumber(kilopascals(takes.upper)), " kPa; expected limits within that, not ",
                  actuator.name, "'s of ", formatNumber(kilopascals(limits.lower)), " to ",
                  formatNumber(kilopascals(limits.upper)), " kPa");
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

// A kind of regulator: its key below `regulator`, with its reader; and that of its profile, a map
// below the same key of a file of its own, where it has one.
struct RegulatorKind {
  const char* key;
  RegulatorReader* read;
  ProfileReader* read_profile = nullptr;
};
constexpr RegulatorKind kKinds[] = {{regulator::SimulatedRegulatorConfig::kKind, readSimulated},
                                    {regulator::SerialConfig::kKind, readSerial,
                                     checked<regulator::SerialProfile, readSerialProfile>},
                                    {regulator::ModbusConfig::kKind, readModbus,
                                     checked<regulator::ModbusProfile, readModbusProfile>}};
static_assert(std::size(kKinds) == std::variant_size_v<regulator::Config>);

const RegulatorKind& kindOf(const std::string& key) {
  return *std::find_if(std::begin(kKinds), std::end(kKinds),
                       [&key](const RegulatorKind& kind) { return kind.key == key; });
}

std::vector<std::string> profileKinds() {
  std::vector<std::string> keys;
  for (const RegulatorKind& kind : kKinds) {
    if (kind.read_profile != nullptr) keys.emplace_back(kind.key);
  }
  return keys;
}

constexpr double kHardwareSlew = 3e5;  // [Pa/s]

constexpr NumberRule seconds(const NumberRule& sign) { return within(sign, 0, 3600, " s"); }

void readAction(const MapReader& keys, const std::string& key,
                const std::optional<regulator::Config>& regulator, control::FaultAction& action) {
  Key(key.c_str(), oneOfNamed(control::kFaultActions), action).read(keys);
  if (action == control::FaultAction::kClose && regulator &&
      !regulator::factsOf(*regulator).closes_valves) {
    keys.complain(key, "is close, but the valves of ", regulator::describe(*regulator),
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
      safety.complain("vented_below_kpa", "is ",
                      formatNumber(kilopascals(config.rules.vented_below)),
                      " by default; expected ", expected);
    }
    return;
  }
}

}  // namespace

std::optional<regulator::Profile> readProfile(const Value& document, const char* kind,
                                              const std::string& name, FaultList& faults) {
  const std::vector<std::string> kinds = profileKinds();
  const MapReader file(document, "", keysOf(kinds), faults);
  const std::optional<std::size_t> found = file.exactlyOne(kinds);
  if (!found) return std::nullopt;
  const std::string& given = kinds[*found];
  if (kind != nullptr && given != kind) {
    file.complain(given, "is not the scene's kind of regulator; expected a profile of ", kind);
    return std::nullopt;
  }
  return kindOf(given).read_profile(*file.find(given), given, name, faults);
}

std::vector<std::string> shippedProfiles() { return shippedNames(kShippedRegulators); }

bool isProfilePath(const std::string& profile) {
  return profile.find('/') != std::string::npos || fs::path(profile).extension() == ".yaml";
}

regulator::Profile loadRegulatorProfile(const std::string& profile) {
  const std::vector<std::string> shipped = shippedProfiles();
  basics::require(isKnown(profile, shipped), "the regulator profile ",
                  basics::quoted(profile, kLongestProfile), " is not shipped; expected ",
                  alternatives(shipped), ", or a path (with a / or ending in .yaml)");
  const fs::path path = pathOf(profile);
  FaultList faults(path.string());
  std::optional<regulator::Profile> read = readContent(path, nullptr, faults);
  faults.throwIfAny();
  return read.value();
}

Value* relativeProfile(Value& scene) {
  Value* const regulator = child(&scene, "regulator");
  for (const char* kind : regulator::kKinds) {
    Value* const profile = child(child(regulator, kind), "profile");
    const bool relative = profile != nullptr && profile->kind == Value::Kind::kText &&
                          isProfilePath(profile->text) && fs::path(profile->text).is_relative();
    if (relative) return profile;
  }
  return nullptr;
}

std::optional<regulator::Config> readRegulator(const MapReader& scene, const ArmParts* arm) {
  const std::vector<std::string> kinds(std::begin(regulator::kKinds), std::end(regulator::kKinds));
  const std::optional<MapReader> regulator = scene.map("regulator", keysOf(kinds));
  if (!regulator) return std::nullopt;
  const std::optional<std::size_t> given = regulator->exactlyOne(kinds);
  if (!given) return std::nullopt;
  const std::string& kind = kinds[*given];
  for (int i = 0; arm != nullptr && i < arm->arm.actuatorCount(); ++i) {
    const model::Actuator& actuator = arm->arm.actuator(i);
    if (model::isPressure(actuator.drive)) continue;
    regulator->complain(kind, "regulates pressures, but ", actuator.name,
                        " is a tendon; expected an arm of pressure actuators or no regulator");
  }
  std::optional<regulator::Config> config = kindOf(kind).read(*regulator, kind, arm);
  if (!config || arm == nullptr || !regulator->isSound()) return std::nullopt;
  try {
    // Constructed for its checks, not connected.
    regulator::makeDriver(*config, arm->arm.actuatorCount());
  } catch (const std::invalid_argument& error) {
    regulator->complain(kind, "cannot be used: ", error.what());
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
  if (rules.target_timeout == 0 && !unknown && (!regulator || hardware)) {
    safety->fault(
        "target_timeout_s",
        "a finite value > 0: only a simulated regulator may wait for targets without limit");
  }
  if (rules.target_timeout <= 0) rules.target_timeout = std::numeric_limits<double>::infinity();
  if (safety->isSound()) checkVentedBelow(*safety, config);
  return config;
}

}  // namespace helix_arm::io
