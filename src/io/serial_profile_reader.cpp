#include "serial_profile_reader.hpp"

#include "helix_arm/io/number.hpp"
#include "map_reader.hpp"
#include "profile_checks.hpp"

namespace helix_arm::io {
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

}  // namespace helix_arm::io
