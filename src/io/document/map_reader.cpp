#include "map_reader.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <numeric>

#include "helix_arm/basics/quote.hpp"
#include "helix_arm/io/number.hpp"

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

Eigen::Matrix3d turn(double degrees, const Eigen::Vector3d& axis) {
  return Eigen::AngleAxisd(radians(degrees), axis).toRotationMatrix();
}

}  // namespace

template <class Number>
Key::Key(const char* name, const NumberRule& rule, Number& into, double unit)
    : Key(
          name,
          [rule, &into, unit](const MapReader& keys, const std::string& key) {
            if (const auto number = keys.number(key, rule)) into = *number * unit;
          },
          [&into, unit](Value& map, const std::string& key) {
            const std::optional<double> number(into);
            if (number) setValue(map, key, numberValue(*number / unit));
          }) {}
template Key::Key(const char*, const NumberRule&, double&, double);
template Key::Key(const char*, const NumberRule&, std::optional<double>&, double);

template <class Integer>
Key::Key(const char* name, Whole rule, Integer& into)
    : Key(
          name,
          [rule, &into](const MapReader& keys, const std::string& key) {
            using Plain = typename decltype(std::optional(into))::value_type;
            if (const auto number = keys.integer(key, rule)) into = static_cast<Plain>(*number);
          },
          [&into](Value& map, const std::string& key) {
            const std::optional<double> number(into);
            if (number) setValue(map, key, numberValue(*number));
          }) {}
template Key::Key(const char*, Whole, int&);
template Key::Key(const char*, Whole, std::optional<int>&);
template Key::Key(const char*, Whole, std::uint32_t&);

Key::Key(const char* name, const NumberRule& rule, std::vector<double*> into)
    : Key(
          name,
          [rule, into](const MapReader& keys, const std::string& key) {
            const auto numbers = keys.numbers(key, into.size(), rule);
            for (std::size_t i = 0; numbers && i < into.size(); ++i) *into[i] = (*numbers)[i];
          },
          [into](Value& map, const std::string& key) {
            Eigen::VectorXd numbers(static_cast<Eigen::Index>(into.size()));
            std::transform(into.begin(), into.end(), numbers.begin(), [](double* x) { return *x; });
            setValue(map, key, numbersValue(numbers));
          }) {}
Key::Key(const char* name, bool& into)
    : Key(
          name,
          [&into](const MapReader& keys, const std::string& key) {
            if (const auto word = keys.choice(key, {"true", "false"})) into = *word == "true";
          },
          [&into](Value& map, const std::string& key) {
            setValue(map, key, plainValue(into ? "true" : "false"));
          }) {}
Key::Key(const char* name, Text rule, std::string& into)
    : Key(
          name,
          [rule, &into](const MapReader& keys, const std::string& key) {
            if (const auto text = keys.text(key, rule.expected)) into = *text;
          },
          [&into](Value& map, const std::string& key) {
            Value value = plainValue(basics::printable(into));
            value.quoted = true;  // it is read back as text
            if (!into.empty()) setValue(map, key, std::move(value));
          }) {}
Key::Key(const char* name, OneOf rule, std::string& into)
    : Key(
          name,
          [rule, &into](const MapReader& keys, const std::string& key) {
            if (const auto word = keys.choice(key, rule.words)) into = *word;
          },
          [&into](Value& map, const std::string& key) { setValue(map, key, plainValue(into)); }) {}
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
  Value map;
  map.kind = Value::Kind::kMap;
  writeKeys(keys, map);
  return map;
}

MapReader::MapReader(const Value& map, std::string path, const std::vector<Key>& keys,
                     FaultList& faults)
    : map_(map), path_(std::move(path)), faults_(faults) {
  std::vector<std::string> known;
  for (const Key& key : keys) known.push_back(key.name());
  if (!isMap()) {
    report("",
           nameOf(path_) + " is " + map_.describe() + "; expected a map of " + alternatives(known));
    return;
  }
  for (const auto& [key, value] : map_.entries) {
    if (std::find(known.begin(), known.end(), key) != known.end()) continue;
    const std::string nearest = nearestWord(key, known);
    const std::string expected =
        nearest.empty() ? "expected " + alternatives(known) : "did you mean " + nearest + "?";
    complain(key, "is not a known key; " + expected);
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
    report("", path(key) + " is missing; expected " + expected);
  }
  return value;
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

std::optional<double> MapReader::optionalNumber(const std::string& key,
                                                const NumberRule& rule) const {
  return has(key) ? number(key, rule) : std::nullopt;
}

std::optional<long long> MapReader::integer(const std::string& key, Whole rule) const {
  const std::string expected =
      "a whole number from " + std::to_string(rule.lowest) + " to " + std::to_string(rule.highest);
  const Value* value = required(key, expected);
  if (value == nullptr) return std::nullopt;
  const std::optional<double> number = finiteNumber(*value);
  if (!number || *number != std::floor(*number) || *number < static_cast<double>(rule.lowest) ||
      *number > static_cast<double>(rule.highest)) {
    fault(key, expected);
    return std::nullopt;
  }
  return static_cast<long long>(*number);
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
    complainOfSize(key, value->entries.size(), expected);
    return std::nullopt;
  }
  std::vector<double> result;
  for (std::size_t i = 0; i < value->entries.size(); ++i) {
    const Value& entry = value->entries[i].value;
    const std::optional<double> number = finiteNumber(entry);
    if (const std::optional<std::string> broken = brokenPart(rule, number)) {
      io::report(faults_, entry.place,
                 indexPath(path(key), i) + " is " + entry.describe() + "; expected " + *broken);
    } else {
      result.push_back(*number);
    }
  }
  if (result.size() != value->entries.size()) return std::nullopt;
  return result;
}

std::optional<Eigen::Vector3d> MapReader::vector3(const std::string& key,
                                                  const NumberRule& rule) const {
  const auto given = numbers(key, 3, rule);
  if (!given) return std::nullopt;
  return Eigen::Vector3d((*given)[0], (*given)[1], (*given)[2]);
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

std::optional<int> MapReader::indexOf(const std::string& key,
                                      const std::vector<std::string>& choices) const {
  const std::optional<std::string> word = choice(key, choices);
  if (!word) return std::nullopt;
  return static_cast<int>(std::find(choices.begin(), choices.end(), *word) - choices.begin());
}

bool MapReader::eachOf(
    const std::string& key,
    const std::function<void(const Value& value, const std::string& path)>& read) const {
  const std::string expected = "a list of at least one entry";
  const Value* value = required(key, expected);
  if (value == nullptr) return false;
  if (value->kind != Value::Kind::kList || value->entries.empty()) {
    const bool hollow = value->kind != Value::Kind::kText && value->entries.empty();
    complain(key, "is " + (hollow ? "empty" : value->describe()) + "; expected " + expected);
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

std::optional<std::string> MapReader::exactlyOne(const std::vector<std::string>& keys) const {
  if (map_.kind != Value::Kind::kMap) return std::nullopt;
  std::vector<std::string> given;
  std::copy_if(keys.begin(), keys.end(), std::back_inserter(given),
               [this](const auto& key) { return has(key); });
  if (given.size() == 1) return given.front();
  const std::string found = given.empty() ? "none" : given[0] + " and " + given[1];
  report("", nameOf(path_) + " has " + found + "; expected exactly one of " + alternatives(keys));
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

}  // namespace helix_arm::io
