#include <algorithm>
#include <cstddef>
#include <filesystem>
#include <optional>
#include <stdexcept>
#include <string>

#include "helix_arm/basics/quote.hpp"
#include "helix_arm/basics/requirement.hpp"
#include "helix_arm/io/fault_list.hpp"
#include "helix_arm/io/number.hpp"
#include "helix_arm/io/shipped_files.hpp"
#include "scene_readers.hpp"

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
              report(keys.faults(), entry.place,
                     indexPath(keys.path(key), i) + " is " + entry.describe() +
                         "; expected a line of text");
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

namespace fs = std::filesystem;

constexpr const char* kSerial = "ascii_serial";
constexpr const char* kModbus = "modbus_tcp";
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

MapReader readSerial(const Value& map, regulator::SerialProfile& profile, FaultList& faults) {
  constexpr Text kLine{"a line of text"}, kSeparator{"the separator of numbers"};
  const OneOf<std::string> kTerminator{{{"cr", "\r"}, {"lf", "\n"}, {"crlf", "\r\n"}}};
  const OneOf<double> kUnit{
      {{"psi", 6894.757293168}, {"kPa", 1e3}, {"bar", 1e5}, {"mbar", 100}, {"Pa", 1}}};
  double scale = 1.0;
  MapReader keys(map, kSerial,
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

MapReader readModbus(const Value& map, regulator::ModbusProfile& profile, FaultList& faults) {
  regulator::ModbusApp app;
  const OneOf<bool> kRegisters{{{"holding", false}, {"input", true}}};
  MapReader keys(map, kModbus,
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

template <class Profile>
std::optional<RegulatorProfile> checked(MapReader (*read)(const Value&, Profile&, FaultList&),
                                        const Value& map, const char* kind, const std::string& name,
                                        FaultList& faults) {
  Profile profile;
  profile.name = name;
  if (!read(map, profile, faults).isSound()) return std::nullopt;
  try {
    profile.validate();
    return profile;
  } catch (const std::invalid_argument& error) {
    report(faults, map.place, kind + std::string(": ") + error.what());
    return std::nullopt;
  }
}

// Content of a profile file, whose kind has to be `kind` unless that is null.
std::optional<RegulatorProfile> readContent(const fs::path& path, const char* kind,
                                            FaultList& faults) {
  const std::optional<std::string> text = readTextFile(path, kMostSceneBytes, faults);
  if (!text) return std::nullopt;
  const std::optional<Value> document =
      parseDocument(*text, {{kSerial, kModbus}, {kSerial, kModbus}, 1}, faults);
  if (!document) return std::nullopt;
  auto profile = readProfile(*document, kind, path.stem(), faults);
  return faults.empty() ? std::move(profile) : std::nullopt;
}

}  // namespace

std::optional<RegulatorProfile> readProfile(const Value& document, const char* kind,
                                            const std::string& name, FaultList& faults) {
  const std::vector<std::string> kinds{kSerial, kModbus};
  const MapReader file(document, "", keysOf(kinds), faults);
  const std::optional<std::size_t> found = file.exactlyOne(kinds);
  if (!found) return std::nullopt;
  if (kind != nullptr && kinds[*found] != kind) {
    file.complain(kinds[*found], "is not the scene's kind of regulator; expected a profile of " +
                                     std::string(kind));
    return std::nullopt;
  }
  const Value& map = *file.find(kinds[*found]);
  return *found == 0 ? checked(readSerial, map, kSerial, name, faults)
                     : checked(readModbus, map, kModbus, name, faults);
}

std::vector<std::string> shippedProfiles() { return shippedNames(kShippedRegulators); }

bool isProfilePath(const std::string& profile) {
  return profile.find('/') != std::string::npos || fs::path(profile).extension() == ".yaml";
}

RegulatorProfile loadRegulatorProfile(const std::string& profile) {
  const std::vector<std::string> shipped = shippedProfiles();
  basics::require(isKnown(profile, shipped), "the regulator profile ",
                  basics::quoted(profile, kLongestProfile), " is not shipped; expected ",
                  alternatives(shipped), ", or a path (with a / or ending in .yaml)");
  const fs::path path = pathOf(profile);
  FaultList faults(path.string());
  std::optional<RegulatorProfile> read = readContent(path, nullptr, faults);
  faults.throwIfAny();
  return read.value();
}

Value* relativeProfile(Value& scene) {
  Value* const regulator = child(&scene, "regulator");
  for (const char* kind : {kSerial, kModbus}) {
    Value* const profile = child(child(regulator, kind), "profile");
    const bool relative = profile != nullptr && profile->kind == Value::Kind::kText &&
                          isProfilePath(profile->text) && fs::path(profile->text).is_relative();
    if (relative) return profile;
  }
  return nullptr;
}

std::optional<RegulatorProfile> readProfileFile(const MapReader& keys, const std::string& kind) {
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
  std::optional<RegulatorProfile> read = readContent(path, kind.c_str(), in_file);
  if (!in_file.empty()) {
    keys.complain("profile",
                  "is " + basics::quoted(*profile, kLongestProfile) + ", which has faults:");
  }
  keys.faults().append(in_file);
  return read;
}

}  // namespace helix_arm::io
