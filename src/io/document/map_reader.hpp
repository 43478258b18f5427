#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <cstdint>
#include <functional>
#include <limits>
#include <optional>
#include <string>
#include <type_traits>
#include <utility>
#include <vector>

#include "basics/pi.hpp"
#include "document.hpp"
#include "helix_arm/io/fault_list.hpp"
#include "helix_arm/lie/se3.hpp"

namespace helix_arm::io {

/// Rule of a number: its sign, and a plausible range. A radius of 25.4 m was probably meant in mm.
struct NumberRule {
  const char* text;  ///< describes the sign, as in "expected a finite value > 0"
  bool (*holds)(double);
  double lowest = -std::numeric_limits<double>::infinity();
  double highest = std::numeric_limits<double>::infinity();
  const char* unit = "";
};

/// A rule of sign with a plausible range.
constexpr NumberRule within(NumberRule rule, double lowest, double highest, const char* unit = "") {
  return {rule.text, rule.holds, lowest, highest, unit};
}

inline constexpr NumberRule kFinite{"a finite value", [](double) { return true; }};
inline constexpr NumberRule kPositive{"a finite value > 0", [](double x) { return x > 0; }};
inline constexpr NumberRule kNotNegative{"a finite value >= 0", [](double x) { return x >= 0; }};
inline constexpr NumberRule kFraction{"a number from 0 to 1",
                                      [](double s) { return s >= 0 && s <= 1; }};
inline constexpr NumberRule kLength = within(kPositive, 1e-6, 10, " m");
inline constexpr NumberRule kCoordinate = within(kFinite, -10, 10, " m");  ///< on the arm
inline constexpr NumberRule kPressure = within(kFinite, -101.325, 1e5, " kPa (gauge)");
inline constexpr NumberRule kPositivePressure = within(kPositive, 1e-3, 1e5, " kPa (gauge)");
inline constexpr NumberRule kStiffness = within(kNotNegative, 0, 1e15);

/// Number of letters to be changed, added or left out between two words (Levenshtein).
std::size_t editDistance(const std::string& a, const std::string& b);

/// For messages on a value beyond its plausible range: the unit by which it would be inside, if it
/// is larger by a factor of 1000 or 100; empty otherwise.
std::string unitHint(double value, const NumberRule& rule);

/// Rule of a whole number.
struct Whole {
  long long lowest, highest;
};
inline constexpr Whole kSeed{0, std::numeric_limits<std::uint32_t>::max()};

/// Rule of a text that is not empty; `expected` describes it in the fault.
struct Text {
  const char* expected;
  bool (*holds)(const std::string&) = nullptr;  ///< none: of any text that can be printed
};
/// A word of letters, digits, `_` and `-`: valid as a tf frame and as a key.
extern const Text kWord;

/// Rule of a list of numbers: so many, or any number of them if that is 0.
struct Numbers {
  NumberRule each;
  std::size_t count = 0;
};

/// Rule of one of a few words, and what each of them stands for.
template <class Meaning>
struct OneOf {
  std::vector<std::pair<std::string, Meaning>> words;
};
/// Words that stand for themselves.
OneOf<std::string> oneOf(const std::vector<std::string>& words);
/// Values by their names.
template <class Values>
auto oneOfNamed(const Values& values) {
  OneOf<std::decay_t<decltype(values[0])>> rule;
  for (const auto& value : values) rule.words.emplace_back(nameOf(value), value);
  return rule;
}

inline constexpr double kDegree = basics::kPi / 180;  ///< [rad]
inline constexpr double kKilo = 1e3;                  ///< kPa [Pa], as pascals()

class MapReader;

/// A row of a schema: a key, its rule, the variable that holds its value, and the SI value of its
/// unit. The same rows read a map and write it:
///
///   Key{"rotation_deg", within(kPositive, 1e-4, 90, " degrees"), prior.rotation, kDegree}
///
/// A missing key leaves its variable as it is, and so does a value that breaks the rule, which is a
/// fault. An optional variable that is absent, and an empty text, are not written. A name alone is
/// a key that its reader reads by other means.
class Key {
 public:
  using Read = std::function<void(const MapReader& keys, const std::string& key)>;
  using Write = std::function<void(Value& map, const std::string& key)>;

  Key(std::string name) : name_(std::move(name)) {}
  Key(const char* name) : name_(name) {}
  Key(const char* name, Read read, Write write = {})
      : name_(name), read_(std::move(read)), write_(std::move(write)) {}
  /// @tparam Rule  what MapReader::read() takes.
  template <class Rule, class Variable>
  Key(const char* name, const Rule& rule, Variable& into, double unit = 1);
  /// A list of as many numbers as the vector has.
  template <int size>
  Key(const char* name, const NumberRule& rule, Eigen::Matrix<double, size, 1>& into)
      : Key(name, Numbers{rule, size}, into) {}
  Key(const char* name, bool& into);
  /// A map of keys, read if it is given.
  Key(const char* name, std::vector<Key> keys);

  /// The same row, whose absence is a fault.
  Key required() &&;

  const std::string& name() const { return name_; }
  void read(const MapReader& keys) const;
  void write(Value& map) const {
    if (write_) write_(map, name_);
  }

 private:
  std::string name_;
  Read read_;
  Write write_;
  bool required_ = false;
};

/// The rows of `position_m` and `rpy_deg`.
std::vector<Key> poseKeys(lie::SE3& X, const NumberRule& coordinate);

/// Sets the keys of a map to the values of their variables.
void writeKeys(const std::vector<Key>& keys, Value& map);
/// A map with these keys alone.
Value mapOf(const std::vector<Key>& keys);

/// Reads the keys of one map by the rules of the schema. A value that breaks a rule is a fault and
/// gives nothing; reading continues.
class MapReader {
 public:
  /// Reports a value that is no map, and keys that the schema does not know; then reads the rows.
  MapReader(const Value& map, std::string path, const std::vector<Key>& keys, FaultList& faults);

  const Value* find(const std::string& key) const { return map_.find(key); }
  bool has(const std::string& key) const { return find(key) != nullptr; }
  bool isMap() const { return map_.kind == Value::Kind::kMap; }
  bool isList(const std::string& key) const {
    return has(key) && find(key)->kind == Value::Kind::kList;
  }
  std::string path(const std::string& key) const { return joinPath(path_, key); }
  FaultList& faults() const { return faults_; }
  /// Whether no fault was found since this map is read.
  bool isSound() const { return faults_.count() == faults_before_; }

  /// The map of a key; nothing without the key.
  std::optional<MapReader> map(const std::string& key, const std::vector<Key>& keys) const;
  /// Calls `read(value, path)` for each entry of a list that must hold at least one.
  /// @return whether there is such a list.
  bool eachOf(const std::string& key,
              const std::function<void(const Value& value, const std::string& path)>& read) const;

  /// The required value of a key; where it breaks its rule, a fault and nothing.
  std::optional<double> read(const std::string& key, const NumberRule& rule) const;
  std::optional<long long> read(const std::string& key, const Whole& rule) const;
  std::optional<std::string> read(const std::string& key, const Text& rule) const;
  std::optional<std::vector<double>> read(const std::string& key, const Numbers& rule) const;
  template <class Meaning>
  std::optional<Meaning> read(const std::string& key, const OneOf<Meaning>& rule) const {
    std::vector<std::string> words;
    for (const auto& [word, meaning] : rule.words) words.push_back(word);
    const std::optional<std::size_t> index = indexOf(key, words);
    return index ? std::optional(rule.words[*index].second) : std::nullopt;
  }
  /// A required value of any kind.
  const Value* required(const std::string& key, const std::string& expected) const;
  /// The entries of a map with at least so many; `expected` describes it in the fault.
  const std::vector<Value::Entry>* entries(const std::string& key, std::size_t least,
                                           const std::string& expected) const;
  /// Which one of several keys is given; a fault if none or more than one is.
  std::optional<std::size_t> exactlyOne(const std::vector<std::string>& keys) const;

  /// Reports `key value; expected rule` at the place of the key; the rule's parts are concatenated.
  template <class... Parts>
  void fault(const std::string& key, const Parts&... rule) const {
    complain(key, has(key) ? "is " + find(key)->describe() : "is missing", "; expected ", rule...);
  }
  /// Reports any other fault of a key (or, if it is missing, of the map).
  template <class... Parts>
  void complain(const std::string& key, const Parts&... fault) const {
    report(key, path(key), " ", fault...);
  }
  /// Reports a message that names the key itself, at the same place.
  template <class... Parts>
  void report(const std::string& key, const Parts&... message) const {
    io::report(faults_, (!key.empty() && has(key) ? *find(key) : map_).place, message...);
  }
  /// Reports `key has count entries; expected rule`.
  template <class... Parts>
  void complainOfSize(const std::string& key, std::size_t count, const Parts&... rule) const {
    complain(key, "has ", count, " entries; expected ", rule...);
  }

 private:
  const Value* valueOf(const std::string& key, const std::string& expected,
                       const std::function<bool(const Value& value)>& holds) const;
  std::optional<std::size_t> indexOf(const std::string& key,
                                     const std::vector<std::string>& words) const;

  const Value& map_;
  std::string path_;
  FaultList& faults_;
  std::size_t faults_before_;
};

/// The value of a variable in a document; nothing where it is absent.
std::optional<Value> written(const std::optional<double>& number, const NumberRule& rule,
                             double unit);
std::optional<Value> written(const std::optional<long long>& number, const Whole& rule, double);
std::optional<Value> written(const std::string& text, const Text& rule, double);
std::optional<Value> written(const std::vector<double>& numbers, const Numbers& rule, double unit);
template <class Meaning>
std::optional<Value> written(const Meaning& meant, const OneOf<Meaning>& rule, double) {
  for (const auto& [word, meaning] : rule.words) {
    if (meaning == meant) return plainValue(word);
  }
  return std::nullopt;
}

template <class Rule, class Variable>
Key::Key(const char* name, const Rule& rule, Variable& into, double unit)
    : Key(
          name,
          [rule, &into, unit](const MapReader& keys, const std::string& key) {
            const auto value = keys.read(key, rule);
            if (!value) return;
            if constexpr (std::is_same_v<Rule, NumberRule>) {
              into = *value * unit;
            } else if constexpr (std::is_same_v<Rule, Numbers>) {
              into.resize(value->size());
              std::transform(value->begin(), value->end(), into.begin(),
                             [unit](double number) { return number * unit; });
            } else {
              into = *value;
            }
          },
          [rule, &into, unit](Value& map, const std::string& key) {
            std::optional<Value> value;
            if constexpr (std::is_same_v<Rule, Numbers>) {
              value = written(std::vector<double>(into.begin(), into.end()), rule, unit);
            } else {
              value = written(into, rule, unit);
            }
            if (value) setValue(map, key, std::move(*value));
          }) {}

/// The words as rows that have their readers.
std::vector<Key> keysOf(const std::vector<std::string>& words);

/// The known word that resembles a mistyped one; empty if none does.
std::string nearestWord(const std::string& word, const std::vector<std::string>& known);

/// "a, b or c".
std::string alternatives(const std::vector<std::string>& words);

constexpr double radians(double degrees) { return degrees * kDegree; }

/// Fixed-axis roll, pitch, yaw: Rz(yaw) Ry(pitch) Rx(roll), angles in degrees.
Eigen::Matrix3d rotationOfRpyDeg(const Eigen::Vector3d& rpy_deg);

/// The angles [degrees] that rotationOfRpyDeg() turns into this rotation, pitch in [-90, 90].
Eigen::Vector3d rpyDegOf(const Eigen::Matrix3d& R);

}  // namespace helix_arm::io
