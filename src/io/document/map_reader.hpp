#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <functional>
#include <limits>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "document.hpp"
#include "helix_arm/basics/pi.hpp"
#include "helix_arm/io/fault_list.hpp"
#include "helix_arm/lie/se3.hpp"

namespace helix_arm::io {

/// Rule of a number: its sign, and a plausible range. A radius of 25.4 m was probably meant as 25.4
/// mm.
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

/// Rule of a whole number.
struct Whole {
  long long lowest, highest;
};
inline constexpr Whole kSeed{0, std::numeric_limits<std::uint32_t>::max()};

/// Rule of a text that is not empty; `expected` describes it in the fault.
struct Text {
  const char* expected;
};

/// Rule of one of a few words.
struct OneOf {
  std::vector<std::string> words;
};

inline constexpr double kDegree = basics::kPi / 180;  ///< [rad]
inline constexpr double kKilo = 1e3;                  ///< kPa [Pa], as pascals()

class MapReader;

/// A row of a schema: a key, its rule, the variable that holds its value, and the SI value of its
/// unit. The same rows read a map and write it:
///
///   Key{"rotation_deg", within(kPositive, 1e-4, 90, " degrees"), prior.rotation, kDegree}
///
/// A missing key leaves its variable as it is, and so does a value that breaks the rule, which is a
/// fault. A name alone is a key that its reader reads by other means.
class Key {
 public:
  using Read = std::function<void(const MapReader& keys, const std::string& key)>;
  using Write = std::function<void(Value& map, const std::string& key)>;

  Key(std::string name) : name_(std::move(name)) {}
  Key(const char* name) : name_(name) {}
  Key(const char* name, Read read, Write write = {})
      : name_(name), read_(std::move(read)), write_(std::move(write)) {}
  /// @tparam Number  double, or an optional of it, which is not written where it is absent.
  template <class Number>
  Key(const char* name, const NumberRule& rule, Number& into, double unit = 1);
  /// A list of so many numbers.
  Key(const char* name, const NumberRule& rule, std::vector<double*> into);
  Key(const char* name, const NumberRule& rule, Eigen::Vector3d& into)
      : Key(name, rule, std::vector{&into[0], &into[1], &into[2]}) {}
  /// @tparam Integer  int, std::uint32_t, or an optional int.
  template <class Integer>
  Key(const char* name, Whole rule, Integer& into);
  Key(const char* name, bool& into);
  /// An empty text is not written.
  Key(const char* name, Text rule, std::string& into);
  Key(const char* name, OneOf rule, std::string& into);
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
  /// Reports a value that is not a map, and each key that the schema does not know; then reads the
  /// rows in their order.
  MapReader(const Value& map, std::string path, const std::vector<Key>& keys, FaultList& faults);

  const Value* find(const std::string& key) const { return map_.find(key); }
  bool has(const std::string& key) const { return find(key) != nullptr; }
  bool isMap() const { return map_.kind == Value::Kind::kMap; }
  bool isList(const std::string& key) const {
    return has(key) && find(key)->kind == Value::Kind::kList;
  }
  std::string path(const std::string& key) const { return joinPath(path_, key); }
  FaultList& faults() const { return faults_; }

  /// The map of a key; nothing without the key.
  std::optional<MapReader> map(const std::string& key, const std::vector<Key>& keys) const;
  /// Calls `read(value, path)` for each entry of a list that must hold at least one.
  /// @return whether there is such a list.
  bool eachOf(const std::string& key,
              const std::function<void(const Value& value, const std::string& path)>& read) const;

  /// A required number.
  std::optional<double> number(const std::string& key, const NumberRule& rule) const;
  /// A number that may be missing; an invalid one is a fault and counts as missing.
  std::optional<double> optionalNumber(const std::string& key, const NumberRule& rule) const;
  std::optional<long long> integer(const std::string& key, Whole rule) const;
  /// A text that is not empty; `expected` describes it in the fault.
  std::optional<std::string> text(const std::string& key, const std::string& expected) const;
  /// A list of numbers; `size` of them unless that is 0.
  std::optional<std::vector<double>> numbers(const std::string& key, std::size_t size,
                                             const NumberRule& rule) const;
  std::optional<Eigen::Vector3d> vector3(const std::string& key, const NumberRule& rule) const;
  /// A word of letters, digits, `_` and `-`: valid as a tf frame and as a key.
  std::optional<std::string> word(const std::string& key) const;
  /// One of a few words.
  std::optional<std::string> choice(const std::string& key,
                                    const std::vector<std::string>& choices) const;
  /// Index of the choice.
  std::optional<int> indexOf(const std::string& key, const std::vector<std::string>& choices) const;
  /// A required value of any kind.
  const Value* required(const std::string& key, const std::string& expected) const;
  /// The entries of a map with at least so many; `expected` describes it in the fault.
  const std::vector<Value::Entry>* entries(const std::string& key, std::size_t least,
                                           const std::string& expected) const;
  /// The one given key out of several; a fault if none or more than one is given.
  std::optional<std::string> exactlyOne(const std::vector<std::string>& keys) const;

  /// Reports `key value; expected rule` at the place of the key.
  void fault(const std::string& key, const std::string& rule) const;
  /// Reports any other fault of a key (or, if it is missing, of the map).
  void complain(const std::string& key, const std::string& fault) const {
    report(key, path(key) + " " + fault);
  }
  /// Reports a message that names the key itself, at the same place.
  void report(const std::string& key, const std::string& message) const {
    io::report(faults_, (!key.empty() && has(key) ? *find(key) : map_).place, message);
  }
  /// Reports `key has count entries; expected rule`.
  void complainOfSize(const std::string& key, std::size_t count, const std::string& rule) const {
    complain(key, "has " + std::to_string(count) + " entries; expected " + rule);
  }

 private:
  const Value& map_;
  std::string path_;
  FaultList& faults_;
};

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
