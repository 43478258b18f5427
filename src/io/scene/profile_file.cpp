#include "profile_file.hpp"

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
#include "io/document/document.hpp"
#include "io/document/map_reader.hpp"

/// Checks common to the profiles of all kinds of regulators.
namespace helix_arm::io {

inline const NumberRule kAtmosphere = within(kNotNegative, 0, 200, " kPa");
inline constexpr int kMostProfileChannels = 1024;
inline const NumberRule kTimeout = within(kPositive, 1e-3, 10, " s");

/// A profile that was read from a map, if it is valid.
///
/// @param path           path of that map, for messages.
/// @param faults_before  number of faults before it was read.
/// @return nothing, and at least one fault, if a rule is broken.
template <class Profile>
std::optional<Profile> checked(const Profile& profile, const Value& map, const std::string& path,
                               std::size_t faults_before, FaultList& faults) {
  if (faults.count() > faults_before) return std::nullopt;
  try {
    profile.validate();
  } catch (const std::invalid_argument& error) {
    report(faults, map.place, path + ": " + error.what());
    return std::nullopt;
  }
  return profile;
}

namespace {

const NumberRule kWatchdog = within(kPositive, 0.1, 60, " s");
const NumberRule kHighest = within(kPositive, 1e-3, 1e5, " kPa");
const NumberRule kScale = within(kPositive, 1e-6, 1e6);

double pascalsOf(const std::string& unit) {
  if (unit == "psi") return 6894.757293168;
  if (unit == "bar") return 1e5;
  if (unit == "mbar") return 100;
  return unit == "kPa" ? 1e3 : 1;
}

std::string terminatorOf(const std::string& word) {
  if (word == "cr") return "\r";
  return word == "lf" ? "\n" : "\r\n";
}

std::string optionalText(const MapReader& keys, const std::string& key, const char* expected,
                         const std::string& fallback = "") {
  return keys.has(key) ? keys.text(key, expected).value_or(fallback) : fallback;
}

// One line, or a list of them; empty if the key is missing.
std::vector<std::string> readLines(const MapReader& keys, const Value& map, const std::string& key,
                                   FaultList& faults) {
  std::vector<std::string> lines;
  const Value* value = map.find(key);
  if (value == nullptr) return lines;
  if (value->kind != Value::Kind::kList) {
    if (const auto line = keys.text(key, "a line of text, or a list of them"))
      lines.push_back(*line);
    return lines;
  }
  for (std::size_t i = 0; i < value->entries.size(); ++i) {
    const Value& entry = value->entries[i].value;
    if (entry.kind == Value::Kind::kText && !entry.text.empty()) {
      lines.push_back(entry.text);
    } else {
      report(
          faults, entry.place,
          indexPath(keys.path(key), i) + " is " + entry.describe() + "; expected a line of text");
    }
  }
  return lines;
}

}  // namespace

std::optional<regulator::SerialProfile> readSerialProfile(const Value& value,
                                                          const std::string& path,
                                                          const std::string& name,
                                                          FaultList& faults) {
  const std::size_t before = faults.count();
  const MapReader keys(value, path, {"baud",        "terminator",     "unit",
                                     "scale",       "atmosphere_kpa", "unit_word",
                                     "decimals",    "separator",      "reply_separator",
                                     "one_by_one",  "start",          "write",
                                     "write_reply", "read",           "reply",
                                     "supply_line", "skip",           "vent",
                                     "close",       "resume",         "vent_reply",
                                     "timeout_s",   "watchdog_s",     "highest_kpa",
                                     "channels",    "checksum"},
                       faults);
  constexpr const char* kLine = "a line of text";
  regulator::SerialProfile profile;
  profile.name = name;
  profile.baud = static_cast<int>(keys.integer("baud", 1200, 2000000, profile.baud));
  profile.terminator = terminatorOf(keys.choice("terminator", {"cr", "lf", "crlf"}).value_or("lf"));
  profile.pascals =
      pascalsOf(keys.choice("unit", {"psi", "kPa", "bar", "mbar", "Pa"}).value_or("Pa")) *
      keys.number("scale", kScale, 1.0);
  profile.atmosphere = pascals(keys.number("atmosphere_kpa", kAtmosphere, 0.0));
  profile.unit_word = optionalText(keys, "unit_word", "a word");
  profile.decimals = static_cast<int>(keys.integer("decimals", 0, 6, profile.decimals));
  profile.separator =
      optionalText(keys, "separator", "the separator of numbers", profile.separator);
  profile.reply_separator =
      optionalText(keys, "reply_separator", "the separator of numbers", profile.separator);
  profile.one_by_one = keys.truth("one_by_one", profile.one_by_one);
  profile.checksum = keys.has("checksum") && keys.choice("checksum", {"none", "crc16"}) == "crc16";
  profile.start = readLines(keys, value, "start", faults);
  profile.write = keys.text("write", kLine).value_or("");
  profile.write_reply = optionalText(keys, "write_reply", kLine);
  profile.read = optionalText(keys, "read", kLine);
  profile.reply = keys.text("reply", kLine).value_or("");
  profile.supply_line = optionalText(keys, "supply_line", kLine);
  profile.skip = readLines(keys, value, "skip", faults);
  if (keys.required("vent", "a line of text, or a list of them") != nullptr) {
    profile.vent = readLines(keys, value, "vent", faults);
  }
  profile.close = readLines(keys, value, "close", faults);
  profile.resume = readLines(keys, value, "resume", faults);
  profile.vent_reply = optionalText(keys, "vent_reply", kLine);
  profile.timeout = keys.number("timeout_s", kTimeout, profile.timeout);
  if (keys.has("watchdog_s")) profile.watchdog = keys.number("watchdog_s", kWatchdog, 0.0);
  if (keys.has("highest_kpa")) {
    profile.highest = pascals(keys.number("highest_kpa", kHighest, 1.0));
  }
  if (keys.has("channels")) {
    profile.channels = static_cast<int>(keys.integer("channels", 1, kMostProfileChannels, 1));
  }
  return checked(profile, value, path, before, faults);
}

namespace {

constexpr int kHighestWord = 0xffff;
constexpr int kLongestStride = 1024;

const NumberRule kCount = within(kPositive, 1e-3, 1e6, " Pa");
const NumberRule kActivationTime = within(kPositive, 0.01, 60, " s");

// A required whole number; an invalid one is reported.
int word(const MapReader& keys, const std::string& key, int lowest = 0,
         int highest = kHighestWord) {
  return static_cast<int>(keys.integer(key, lowest, highest).value_or(lowest));
}

void readOutputs(const Value& value, const std::string& path, regulator::ModbusProfile& profile,
                 FaultList& faults) {
  const MapReader keys(value, path, {"first", "stride", "pressure"}, faults);
  profile.output_base = word(keys, "first");
  profile.output_stride = word(keys, "stride", 1, kLongestStride);
  profile.output_pressure = word(keys, "pressure", 0, kLongestStride - 1);
}

void readInputs(const Value& value, const std::string& path, regulator::ModbusProfile& profile,
                FaultList& faults) {
  const MapReader keys(value, path, {"first", "stride", "pressure", "registers"}, faults);
  profile.input_base = word(keys, "first");
  profile.input_stride = word(keys, "stride", 1, kLongestStride);
  profile.input_pressure = word(keys, "pressure", 0, kLongestStride - 1);
  profile.input_registers = keys.choice("registers", {"holding", "input"}) == "input";
}

regulator::ModbusApp readApp(const Value& value, const std::string& path, FaultList& faults) {
  const MapReader keys(value, path,
                       {"command", "regulate", "off", "acknowledge", "status", "status_mask",
                        "ready", "running", "activation_time_s"},
                       faults);
  regulator::ModbusApp app;
  app.command = word(keys, "command", 0, kLongestStride - 1);
  app.regulate = word(keys, "regulate");
  app.off = word(keys, "off");
  app.acknowledge = word(keys, "acknowledge");
  app.status = word(keys, "status", 0, kLongestStride - 1);
  app.status_mask = static_cast<int>(keys.integer("status_mask", 1, kHighestWord, app.status_mask));
  app.ready = word(keys, "ready");
  app.running = word(keys, "running");
  app.activation_time = keys.number("activation_time_s", kActivationTime, app.activation_time);
  return app;
}

}  // namespace

std::optional<regulator::ModbusProfile> readModbusProfile(const Value& value,
                                                          const std::string& path,
                                                          const std::string& name,
                                                          FaultList& faults) {
  const std::size_t before = faults.count();
  const MapReader keys(value, path,
                       {"unit_id", "count_pa", "atmosphere_kpa", "highest_count", "outlets",
                        "channels", "outputs", "inputs", "supply", "app", "timeout_s"},
                       faults);
  regulator::ModbusProfile profile;
  profile.name = name;
  profile.unit_id = static_cast<int>(keys.integer("unit_id", 0, 255, profile.unit_id));
  profile.pascals = keys.number("count_pa", kCount).value_or(profile.pascals);
  profile.atmosphere = pascals(keys.number("atmosphere_kpa", kAtmosphere, 0.0));
  profile.highest_count = word(keys, "highest_count", 1, 32767);
  profile.outlets = static_cast<int>(keys.integer("outlets", 1, 64, profile.outlets));
  if (keys.has("channels")) profile.channels = word(keys, "channels", 1, kMostProfileChannels);
  if (const Value* outputs = keys.required("outputs", "a map of first, stride and pressure")) {
    readOutputs(*outputs, keys.path("outputs"), profile, faults);
  }
  if (const Value* inputs =
          keys.required("inputs", "a map of first, stride, pressure and registers")) {
    readInputs(*inputs, keys.path("inputs"), profile, faults);
  }
  if (keys.has("supply")) profile.supply = word(keys, "supply");
  if (const Value* app = value.find("app")) profile.app = readApp(*app, keys.path("app"), faults);
  profile.timeout = keys.number("timeout_s", kTimeout, profile.timeout);
  return checked(profile, value, path, before, faults);
}

namespace {

namespace fs = std::filesystem;

constexpr const char* kSerial = "ascii_serial";
constexpr const char* kModbus = "modbus_tcp";
constexpr std::size_t kLongestProfile = 200;  // of a path, in a message

fs::path pathOf(const std::string& profile) {
  return isProfilePath(profile) ? fs::path(profile)
                                : fs::path(shippedFolder(kShippedRegulators)) / (profile + ".yaml");
}

// The value of a key; null without a map or without the key.
Value* child(Value* map, const char* key) {
  return map == nullptr ? nullptr : const_cast<Value*>(map->find(key));
}

template <class Profile>
using Reader = std::optional<Profile> (*)(const Value&, const std::string&, const std::string&,
                                          FaultList&);

std::optional<Value> readDocument(const fs::path& path, FaultList& faults) {
  const std::optional<std::string> text = readTextFile(path, kMostSceneBytes, faults);
  if (!text) return std::nullopt;
  return parseDocument(*text, {{kSerial, kModbus}, {kSerial, kModbus}, 1}, faults);
}

// Content of a profile file's document below its single top-level key.
template <class Profile>
std::optional<Profile> readContent(const Value& document, const fs::path& path, const char* kind,
                                   Reader<Profile> reader, FaultList& faults) {
  const MapReader file(document, "", {kSerial, kModbus}, faults);
  const std::optional<std::string> found = file.exactlyOne({kSerial, kModbus});
  if (!found) return std::nullopt;
  if (*found != kind) {
    file.complain(
        *found, "is not the scene's kind of regulator; expected a profile of " + std::string(kind));
    return std::nullopt;
  }
  std::optional<Profile> profile = reader(*document.find(kind), kind, path.stem().string(), faults);
  return faults.empty() ? std::move(profile) : std::nullopt;
}

template <class Profile>
std::optional<Profile> readProfile(const MapReader& keys, const char* kind, Reader<Profile> reader,
                                   FaultList& faults) {
  const std::vector<std::string> shipped = shippedProfiles();
  const std::string expected =
      alternatives(shipped) + ", or a path (with a / or ending in .yaml) from the scene's folder";
  const std::optional<std::string> profile = keys.text("profile", expected);
  if (!profile) return std::nullopt;
  if (!isProfilePath(*profile) &&
      std::find(shipped.begin(), shipped.end(), *profile) == shipped.end()) {
    keys.fault("profile", expected);
    return std::nullopt;
  }
  const fs::path path = pathOf(*profile);
  FaultList in_file(path.string());
  std::optional<Profile> read;
  if (const std::optional<Value> document = readDocument(path, in_file)) {
    read = readContent(*document, path, kind, reader, in_file);
  }
  if (!in_file.empty())
    keys.complain("profile",
                  "is " + basics::quoted(*profile, kLongestProfile) + ", which has faults:");
  faults.append(in_file);
  return read;
}

}  // namespace

std::vector<std::string> shippedProfiles() { return shippedNames(kShippedRegulators); }

bool isProfilePath(const std::string& profile) {
  return profile.find('/') != std::string::npos || fs::path(profile).extension() == ".yaml";
}

RegulatorProfile loadRegulatorProfile(const std::string& profile) {
  const std::vector<std::string> shipped = shippedProfiles();
  basics::require(
      isProfilePath(profile) || std::find(shipped.begin(), shipped.end(), profile) != shipped.end(),
      "the regulator profile ", basics::quoted(profile, kLongestProfile),
      " is not shipped; expected ", alternatives(shipped),
      ", or a path (with a / or ending in .yaml)");
  const fs::path path = pathOf(profile);
  FaultList faults(path.string());
  std::optional<RegulatorProfile> read;
  const std::optional<Value> document = readDocument(path, faults);
  if (document && document->find(kModbus) != nullptr) {
    read =
        readContent<regulator::ModbusProfile>(*document, path, kModbus, readModbusProfile, faults);
  } else if (document) {
    read =
        readContent<regulator::SerialProfile>(*document, path, kSerial, readSerialProfile, faults);
  }
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

std::optional<regulator::SerialProfile> readSerialProfileFile(const MapReader& keys,
                                                              FaultList& faults) {
  return readProfile<regulator::SerialProfile>(keys, kSerial, readSerialProfile, faults);
}

std::optional<regulator::ModbusProfile> readModbusProfileFile(const MapReader& keys,
                                                              FaultList& faults) {
  return readProfile<regulator::ModbusProfile>(keys, kModbus, readModbusProfile, faults);
}

}  // namespace helix_arm::io
