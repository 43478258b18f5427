#include "map_reader.hpp"

#include <Eigen/Geometry>
#include <cmath>
#include <numeric>

#include "basics/quote.hpp"
#include "number.hpp"

namespace helix_arm::io {
namespace {

bool isPlain(const std::string& text) {
  std::string without_tabs = text;
  std::replace(without_tabs.begin(), without_tabs.end(), '\t', ' ');
  return basics::printable(without_tabs) == without_tabs;
}

std::optional<double> finiteNumber(const Value& value) {
  if (value.kind != Value::Kind::kText || value.quoted) return std::nullopt;
  return parseNumber(value.text);
}

// The part of a rule that a value breaks; absent if it satisfies the rule.
std::optional<std::string> brokenPart(const NumberRule& rule, const std::optional<double>& number) {
  if (!number || !rule.holds(*number)) return rule.text;
  if (*number >= rule.lowest && *number <= rule.highest) return std::nullopt;
  return formatNumber(rule.lowest) + " to " + formatNumber(rule.highest) + rule.unit +
         unitHint(*number, rule);
}

double inUnit(double number, double unit) {
  return unit == kKilo ? kilopascals(number) : number / unit;
}

Eigen::Matrix3d turn(double degrees, const Eigen::Vector3d& axis) {
  return Eigen::AngleAxisd(radians(degrees), axis).toRotationMatrix();
}

}  // namespace

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

std::string unitHint(double value, const NumberRule& rule) {
  if (std::string(rule.unit) != kLength.unit) return "";
  const auto within = [&rule](double number) {
    return number >= rule.lowest && number <= rule.highest;
  };
  if (within(1e-3 * value)) return ", " + formatNumber(1e-3 * value) + " if it is in millimetres";
  if (within(1e-2 * value)) return ", " + formatNumber(1e-2 * value) + " if it is in centimetres";
  return "";
}

const Text kWord{"a word of letters, digits, _ and -", [](const std::string& text) {
                   return std::all_of(text.begin(), text.end(), [](char c) {
                     return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') ||
                            (c >= '0' && c <= '9') || c == '_' || c == '-';
                   });
                 }};

Key::Key(const char* name, bool& into)
    : Key(name, OneOf<bool>{{{"true", true}, {"false", false}}}, into) {}
Key::Key(const char* name, std::vector<Key> keys)
    : Key(name,
          [keys](const MapReader& reader, const std::string& key) { reader.map(key, keys); }) {}

Key Key::required() && {
  required_ = true;
  return std::move(*this);
}

void Key::read(const MapReader& keys) const {
  if (read_ && (required_ || keys.has(name_))) read_(keys, name_);
}

std::vector<Key> keysOf(const std::vector<std::string>& words) {
  return {words.begin(), words.end()};
}

std::vector<Key> poseKeys(lie::SE3& X, const NumberRule& coordinate) {
  return {{"position_m", coordinate, X.translation},
          {"rpy_deg",
           [&X](const MapReader& keys, const std::string& key) {
             Eigen::Vector3d rpy_deg = rpyDegOf(X.rotation);
             Key(key.c_str(), kFinite, rpy_deg).read(keys);
             X.rotation = rotationOfRpyDeg(rpy_deg);
           },
           [&X](Value& map, const std::string& key) {
             setValue(map, key, numbersValue(rpyDegOf(X.rotation)));
           }}};
}

void writeKeys(const std::vector<Key>& keys, Value& map) {
  for (const Key& key : keys) key.write(map);
}

Value mapOf(const std::vector<Key>& keys) {
  Value map{Value::Kind::kMap, {}, false, {}, {}};
  writeKeys(keys, map);
  return map;
}

MapReader::MapReader(const Value& map, std::string path, const std::vector<Key>& keys,
                     FaultList& faults)
    : map_(map), path_(std::move(path)), faults_(faults), faults_before_(faults.count()) {
  std::vector<std::string> known;
  for (const Key& key : keys) known.push_back(key.name());
  if (!isMap()) {
    report("", nameOf(path_), " is ", map_.describe(), "; expected a map of ", alternatives(known));
    return;
  }
  for (const auto& [key, value] : map_.entries) {
    if (std::find(known.begin(), known.end(), key) != known.end()) continue;
    const std::string nearest = nearestWord(key, known);
    complain(key, "is not a known key; ",
             nearest.empty() ? "expected " + alternatives(known) : "did you mean " + nearest + "?");
  }
  for (const Key& key : keys) key.read(*this);
}

std::optional<MapReader> MapReader::map(const std::string& key,
                                        const std::vector<Key>& keys) const {
  if (!has(key)) return std::nullopt;
  return MapReader(*find(key), path(key), keys, faults_);
}

const Value* MapReader::required(const std::string& key, const std::string& expected) const {
  const Value* value = map_.find(key);
  // A value that is not a map was reported as a whole.
  if (value == nullptr && map_.kind == Value::Kind::kMap) {
    report("", path(key), " is missing; expected ", expected);
  }
  return value;
}

// The value of a required key that fits; otherwise a fault.
const Value* MapReader::valueOf(const std::string& key, const std::string& expected,
                                const std::function<bool(const Value& value)>& holds) const {
  const Value* value = required(key, expected);
  if (value == nullptr || holds(*value)) return value;
  fault(key, expected);
  return nullptr;
}

std::optional<double> MapReader::read(const std::string& key, const NumberRule& rule) const {
  const Value* value = required(key, rule.text);
  if (value == nullptr) return std::nullopt;
  const std::optional<double> number = finiteNumber(*value);
  const std::optional<std::string> broken = brokenPart(rule, number);
  if (broken) fault(key, *broken);
  return broken ? std::nullopt : number;
}

std::optional<long long> MapReader::read(const std::string& key, const Whole& rule) const {
  const std::string expected =
      basics::messageOf("a whole number from ", rule.lowest, " to ", rule.highest);
  const Value* found = valueOf(key, expected, [&rule](const Value& value) {
    const std::optional<double> number = finiteNumber(value);
    return number && *number == std::floor(*number) &&
           *number >= static_cast<double>(rule.lowest) &&
           *number <= static_cast<double>(rule.highest);
  });
  if (found == nullptr) return std::nullopt;
  return static_cast<long long>(*finiteNumber(*found));
}

std::optional<std::string> MapReader::read(const std::string& key, const Text& rule) const {
  const Value* found = valueOf(key, rule.expected, [&rule](const Value& value) {
    return value.kind == Value::Kind::kText && !value.text.empty() &&
           (rule.holds == nullptr || rule.holds(value.text));
  });
  if (found == nullptr) return std::nullopt;
  // Names and addresses reach messages, logs and terminals. Lines of a device may hold tabs.
  if (!isPlain(found->text)) {
    complain(key, "is ", found->describe(), ", which holds a control character; expected ",
             rule.expected);
    return std::nullopt;
  }
  return found->text;
}

std::optional<std::vector<double>> MapReader::read(const std::string& key,
                                                   const Numbers& rule) const {
  const std::string expected = "a list of " +
                               (rule.count == 0 ? "" : std::to_string(rule.count) + " ") +
                               "numbers, each " + rule.each.text;
  const Value* list =
      valueOf(key, expected, [](const Value& value) { return value.kind == Value::Kind::kList; });
  if (list == nullptr) return std::nullopt;
  if (rule.count != 0 && list->entries.size() != rule.count) {
    complainOfSize(key, list->entries.size(), expected);
    return std::nullopt;
  }
  std::vector<double> result;
  for (std::size_t i = 0; i < list->entries.size(); ++i) {
    const Value& entry = list->entries[i].value;
    const std::optional<double> number = finiteNumber(entry);
    if (const std::optional<std::string> broken = brokenPart(rule.each, number)) {
      io::report(faults_, entry.place, indexPath(path(key), i), " is ", entry.describe(),
                 "; expected ", *broken);
    } else {
      result.push_back(*number);
    }
  }
  if (result.size() != list->entries.size()) return std::nullopt;
  return result;
}

std::optional<std::size_t> MapReader::indexOf(const std::string& key,
                                              const std::vector<std::string>& words) const {
  auto word = words.end();
  valueOf(key, alternatives(words), [&](const Value& value) {
    if (value.kind == Value::Kind::kText) word = std::find(words.begin(), words.end(), value.text);
    return word != words.end();
  });
  if (word == words.end()) return std::nullopt;
  return static_cast<std::size_t>(word - words.begin());
}

bool MapReader::eachOf(
    const std::string& key,
    const std::function<void(const Value& value, const std::string& path)>& read) const {
  const std::string expected = "a list of at least one entry";
  const Value* value = required(key, expected);
  if (value == nullptr) return false;
  if (value->kind != Value::Kind::kList || value->entries.empty()) {
    const bool hollow = value->kind != Value::Kind::kText && value->entries.empty();
    complain(key, "is ", hollow ? "empty" : value->describe(), "; expected ", expected);
    return false;
  }
  for (std::size_t i = 0; i < value->entries.size(); ++i) {
    read(value->entries[i].value, indexPath(path(key), i));
  }
  return true;
}

const std::vector<Value::Entry>* MapReader::entries(const std::string& key, std::size_t least,
                                                    const std::string& expected) const {
  const Value* value = required(key, expected);
  if (value == nullptr) return nullptr;
  if (value->kind == Value::Kind::kMap && value->entries.size() >= least) return &value->entries;
  fault(key, expected);
  return nullptr;
}

std::optional<std::size_t> MapReader::exactlyOne(const std::vector<std::string>& keys) const {
  if (!isMap()) return std::nullopt;
  std::vector<std::size_t> given;
  for (std::size_t i = 0; i < keys.size(); ++i) {
    if (has(keys[i])) given.push_back(i);
  }
  if (given.size() == 1) return given.front();
  report("", nameOf(path_), " has ",
         given.empty() ? "none" : keys[given[0]] + " and " + keys[given[1]],
         "; expected exactly one of ", alternatives(keys));
  return std::nullopt;
}

std::optional<Value> written(const std::optional<double>& number, const NumberRule&, double unit) {
  if (!number) return std::nullopt;
  return numberValue(inUnit(*number, unit));
}

std::optional<Value> written(const std::optional<long long>& number, const Whole&, double) {
  if (!number) return std::nullopt;
  return plainValue(std::to_string(*number));
}

std::optional<Value> written(const std::string& text, const Text&, double) {
  if (text.empty()) return std::nullopt;
  Value value = plainValue(basics::printable(text));
  value.quoted = true;  // it is read back as text
  return value;
}

std::optional<Value> written(const std::vector<double>& numbers, const Numbers&, double unit) {
  std::vector<Value> values;
  for (const double number : numbers) values.push_back(numberValue(inUnit(number, unit)));
  return listValue(values);
}

OneOf<std::string> oneOf(const std::vector<std::string>& words) {
  OneOf<std::string> rule;
  for (const std::string& word : words) rule.words.emplace_back(word, word);
  return rule;
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

Eigen::Matrix3d rotationOfRpyDeg(const Eigen::Vector3d& rpy_deg) {
  return turn(rpy_deg[2], Eigen::Vector3d::UnitZ()) * turn(rpy_deg[1], Eigen::Vector3d::UnitY()) *
         turn(rpy_deg[0], Eigen::Vector3d::UnitX());
}

Eigen::Vector3d rpyDegOf(const Eigen::Matrix3d& R) {
  // Near a pitch of 90 degrees the yaw is arbitrary; roll follows from it: accurate to rounding.
  const double yaw = std::atan2(R(1, 0), R(0, 0));
  const double c = std::cos(yaw), s = std::sin(yaw);
  const double pitch = std::atan2(-R(2, 0), c * R(0, 0) + s * R(1, 0));
  const double roll = std::atan2(s * R(0, 2) - c * R(1, 2), c * R(1, 1) - s * R(0, 1));
  return Eigen::Vector3d(roll, pitch, yaw) * (180 / basics::kPi);
}

}  // namespace helix_arm::io
