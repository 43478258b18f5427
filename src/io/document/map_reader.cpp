#include "map_reader.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <numeric>

#include "helix_arm/basics/pi.hpp"
#include "helix_arm/basics/quote.hpp"
#include "helix_arm/io/number.hpp"

namespace helix_arm::io {
namespace {

bool isPlain(const std::string& text) {
  std::string without_tabs = text;
  std::replace(without_tabs.begin(), without_tabs.end(), '\t', ' ');
  return basics::printable(without_tabs) == without_tabs;
}

bool any(double) { return true; }
bool positive(double x) { return x > 0; }
bool notNegative(double x) { return x >= 0; }

}  // namespace

constexpr NumberRule kFinite{"a finite value", any};
constexpr NumberRule kPositive{"a finite value > 0", positive};
constexpr NumberRule kNotNegative{"a finite value >= 0", notNegative};
constexpr NumberRule kLength{"a finite value > 0", positive, 1e-6, 10, " m"};
constexpr NumberRule kCoordinate{"a finite value", any, -10, 10, " m"};
constexpr NumberRule kPressure{"a finite value", any, -101.325, 1e5, " kPa (gauge)"};
constexpr NumberRule kPositivePressure{"a finite value > 0", positive, 1e-3, 1e5, " kPa (gauge)"};
constexpr NumberRule kStiffness{"a finite value >= 0", notNegative, 0, 1e15};

NumberRule within(NumberRule rule, double lowest, double highest, const char* unit) {
  rule.lowest = lowest;
  rule.highest = highest;
  rule.unit = unit;
  return rule;
}

namespace {

std::optional<double> finiteNumber(const Value& value) {
  if (value.kind != Value::Kind::kText || value.quoted) return std::nullopt;
  return parseNumber(value.text);
}

// The part of a rule that a value breaks; absent if it satisfies the rule.
std::optional<std::string> brokenPart(const NumberRule& rule, const std::optional<double>& number) {
  if (!number || !rule.holds(*number)) return rule.text;
  if (*number >= rule.lowest && *number <= rule.highest) return std::nullopt;
  return formatNumber(rule.lowest) + " to " + formatNumber(rule.highest) + rule.unit;
}

// Levenshtein distance between two words.
std::size_t editDistance(const std::string& a, const std::string& b) {
  std::vector<std::size_t> row(b.size() + 1);
  std::iota(row.begin(), row.end(), 0);
  for (std::size_t i = 0; i < a.size(); ++i) {
    std::size_t diagonal = row[0]++;
    for (std::size_t j = 0; j < b.size(); ++j) {
      const std::size_t replaced = diagonal + (a[i] == b[j] ? 0 : 1);
      diagonal = row[j + 1];
      row[j + 1] = std::min({replaced, row[j] + 1, row[j + 1] + 1});
    }
  }
  return row.back();
}

}  // namespace

MapReader::MapReader(const Value& map, std::string path, std::vector<std::string> known,
                     FaultList& faults)
    : map_(map), path_(std::move(path)), faults_(faults) {
  if (map_.kind != Value::Kind::kMap) {
    report(faults_, map_.place,
           nameOf(path_) + " is " + map_.describe() + "; expected a map of " + alternatives(known));
    return;
  }
  for (const auto& [key, value] : map_.entries) {
    if (std::find(known.begin(), known.end(), key) != known.end()) continue;
    const std::string nearest = nearestWord(key, known);
    const std::string expected =
        nearest.empty() ? "expected " + alternatives(known) : "did you mean " + nearest + "?";
    report(faults_, value.place, this->path(key) + " is not a known key; " + expected);
  }
}

const Value* MapReader::required(const std::string& key, const std::string& expected) const {
  const Value* value = map_.find(key);
  // A value that is not a map was reported as a whole.
  if (value == nullptr && map_.kind == Value::Kind::kMap) {
    report(faults_, map_.place, path(key) + " is missing; expected " + expected);
  }
  return value;
}

void MapReader::complain(const std::string& key, const std::string& fault) const {
  const Value* value = map_.find(key);
  report(faults_, value == nullptr ? map_.place : value->place, path(key) + " " + fault);
}

void MapReader::fault(const std::string& key, const std::string& rule) const {
  const Value* value = map_.find(key);
  complain(key,
           (value == nullptr ? "is missing" : "is " + value->describe()) + "; expected " + rule);
}

std::optional<double> MapReader::number(const std::string& key, const NumberRule& rule) const {
  const Value* value = required(key, rule.text);
  if (value == nullptr) return std::nullopt;
  const std::optional<double> number = finiteNumber(*value);
  const std::optional<std::string> broken = brokenPart(rule, number);
  if (broken) fault(key, *broken);
  return broken ? std::nullopt : number;
}

double MapReader::number(const std::string& key, const NumberRule& rule, double fallback) const {
  return has(key) ? number(key, rule).value_or(fallback) : fallback;
}

std::optional<double> MapReader::optionalNumber(const std::string& key,
                                                const NumberRule& rule) const {
  return has(key) ? number(key, rule) : std::nullopt;
}

std::optional<long long> MapReader::integer(const std::string& key, long long lowest,
                                            long long highest) const {
  const std::string rule =
      "a whole number from " + std::to_string(lowest) + " to " + std::to_string(highest);
  const Value* value = required(key, rule);
  if (value == nullptr) return std::nullopt;
  const std::optional<double> number = finiteNumber(*value);
  const auto in_double = [](long long x) { return static_cast<double>(x); };
  if (!number || *number != std::floor(*number) || *number < in_double(lowest) ||
      *number > in_double(highest)) {
    fault(key, rule);
    return std::nullopt;
  }
  return static_cast<long long>(*number);
}

long long MapReader::integer(const std::string& key, long long lowest, long long highest,
                             long long fallback) const {
  return has(key) ? integer(key, lowest, highest).value_or(fallback) : fallback;
}

bool MapReader::truth(const std::string& key, bool fallback) const {
  if (!has(key)) return fallback;
  const std::optional<std::string> word = choice(key, {"true", "false"});
  return word ? *word == "true" : fallback;
}

std::optional<std::string> MapReader::text(const std::string& key,
                                           const std::string& expected) const {
  const Value* value = required(key, expected);
  if (value == nullptr) return std::nullopt;
  if (value->kind != Value::Kind::kText || value->text.empty()) {
    fault(key, expected);
    return std::nullopt;
  }
  // Names and addresses reach messages, logs and terminals. Lines of a device may hold tabs.
  if (!isPlain(value->text)) {
    complain(key,
             "is " + value->describe() + ", which holds a control character; expected " + expected);
    return std::nullopt;
  }
  return value->text;
}

std::optional<std::vector<double>> MapReader::numbers(const std::string& key, std::size_t size,
                                                      const NumberRule& rule) const {
  const std::string expected = "a list of " +
                               (size == 0 ? "numbers" : std::to_string(size) + " numbers") +
                               ", each " + rule.text;
  const Value* value = required(key, expected);
  if (value == nullptr) return std::nullopt;
  if (value->kind != Value::Kind::kList) {
    fault(key, expected);
    return std::nullopt;
  }
  if (size != 0 && value->entries.size() != size) {
    complain(key,
             "has " + std::to_string(value->entries.size()) + " entries; expected " + expected);
    return std::nullopt;
  }
  std::vector<double> result;
  for (std::size_t i = 0; i < value->entries.size(); ++i) {
    const Value& entry = value->entries[i].value;
    const std::optional<double> number = finiteNumber(entry);
    if (const std::optional<std::string> broken = brokenPart(rule, number)) {
      report(faults_, entry.place,
             indexPath(path(key), i) + " is " + entry.describe() + "; expected " + *broken);
    } else {
      result.push_back(*number);
    }
  }
  if (result.size() != value->entries.size()) return std::nullopt;
  return result;
}

std::optional<std::string> MapReader::word(const std::string& key) const {
  const std::string expected = "a word of letters, digits, _ and -";
  const Value* value = required(key, expected);
  if (value == nullptr) return std::nullopt;
  const auto fits = [](char c) {
    return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') || c == '_' ||
           c == '-';
  };
  const std::string& text = value->text;
  if (value->kind != Value::Kind::kText || text.empty() ||
      !std::all_of(text.begin(), text.end(), fits)) {
    fault(key, expected);
    return std::nullopt;
  }
  return text;
}

std::optional<std::string> MapReader::choice(const std::string& key,
                                             const std::vector<std::string>& choices) const {
  const Value* value = required(key, alternatives(choices));
  if (value == nullptr) return std::nullopt;
  if (value->kind != Value::Kind::kText ||
      std::find(choices.begin(), choices.end(), value->text) == choices.end()) {
    fault(key, alternatives(choices));
    return std::nullopt;
  }
  return value->text;
}

const std::vector<Value::Entry>* MapReader::list(const std::string& key) const {
  const std::string expected = "a list of at least one entry";
  const Value* value = required(key, expected);
  if (value == nullptr) return nullptr;
  if (value->kind != Value::Kind::kList || value->entries.empty()) {
    const bool hollow = value->kind != Value::Kind::kText && value->entries.empty();
    complain(key, "is " + (hollow ? "empty" : value->describe()) + "; expected " + expected);
    return nullptr;
  }
  return &value->entries;
}

std::optional<std::string> MapReader::exactlyOne(const std::vector<std::string>& keys) const {
  if (map_.kind != Value::Kind::kMap) return std::nullopt;
  std::vector<std::string> given;
  std::copy_if(keys.begin(), keys.end(), std::back_inserter(given),
               [this](const auto& key) { return has(key); });
  if (given.size() == 1) return given.front();
  const std::string found = given.empty() ? "none" : given[0] + " and " + given[1];
  report(faults_, map_.place,
         nameOf(path_) + " has " + found + "; expected exactly one of " + alternatives(keys));
  return std::nullopt;
}

std::string nearestWord(const std::string& word, const std::vector<std::string>& known) {
  std::string nearest;
  std::size_t least = word.size() / 2 + 1;  // beyond, the words are not similar
  for (const std::string& candidate : known) {
    const auto [shorter, longer] = std::minmax({word.size(), candidate.size()});
    if (longer - shorter >= least) continue;
    const std::size_t distance = editDistance(word, candidate);
    if (distance < least) {
      least = distance;
      nearest = candidate;
    }
  }
  return nearest;
}

std::string alternatives(const std::vector<std::string>& words) {
  std::string text;
  for (std::size_t i = 0; i < words.size(); ++i) {
    if (i > 0) text += i + 1 == words.size() ? " or " : ", ";
    text += words[i];
  }
  return text;
}

namespace {

Eigen::Matrix3d turn(double degrees, const Eigen::Vector3d& axis) {
  return Eigen::AngleAxisd(radians(degrees), axis).toRotationMatrix();
}

}  // namespace

double radians(double degrees) { return degrees * (basics::kPi / 180); }

Eigen::Matrix3d rotationOfRpyDeg(const Eigen::Vector3d& rpy_deg) {
  return turn(rpy_deg[2], Eigen::Vector3d::UnitZ()) * turn(rpy_deg[1], Eigen::Vector3d::UnitY()) *
         turn(rpy_deg[0], Eigen::Vector3d::UnitX());
}

Eigen::Vector3d rpyDegOf(const Eigen::Matrix3d& R) {
  // Near a pitch of 90 degrees the yaw is arbitrary; roll is computed from it, so that the rotation
  // is accurate to rounding.
  const double yaw = std::atan2(R(1, 0), R(0, 0));
  const double c = std::cos(yaw), s = std::sin(yaw);
  const double pitch = std::atan2(-R(2, 0), c * R(0, 0) + s * R(1, 0));
  const double roll = std::atan2(s * R(0, 2) - c * R(1, 2), c * R(1, 1) - s * R(0, 1));
  return Eigen::Vector3d(roll, pitch, yaw) * (180 / basics::kPi);
}

std::optional<Eigen::Vector3d> vector3(const std::optional<std::vector<double>>& numbers) {
  if (!numbers) return std::nullopt;
  return Eigen::Vector3d((*numbers)[0], (*numbers)[1], (*numbers)[2]);
}

lie::SE3 readPose(const MapReader& keys, const NumberRule& coordinate) {
  lie::SE3 X;
  if (keys.has("position_m")) {
    const auto p = vector3(keys.numbers("position_m", 3, coordinate));
    if (p) X.translation = *p;
  }
  if (keys.has("rpy_deg")) {
    const auto rpy_deg = vector3(keys.numbers("rpy_deg", 3, kFinite));
    if (rpy_deg) X.rotation = rotationOfRpyDeg(*rpy_deg);
  }
  return X;
}

}  // namespace helix_arm::io
