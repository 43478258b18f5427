#pragma once

#include <Eigen/Core>
#include <limits>
#include <optional>
#include <string>
#include <vector>

#include "document.hpp"
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
extern const NumberRule kFinite;
extern const NumberRule kPositive;
extern const NumberRule kNotNegative;
extern const NumberRule kLength;            ///< > 0 [m]
extern const NumberRule kCoordinate;        ///< on the arm [m]
extern const NumberRule kPressure;          ///< gauge [kPa]
extern const NumberRule kPositivePressure;  ///< gauge [kPa]
extern const NumberRule kStiffness;         ///< >= 0

/// A rule of sign with a plausible range.
NumberRule within(NumberRule rule, double lowest, double highest, const char* unit = "");

/// Reads the keys of one map by the rules of the schema. A value that breaks a rule is a fault and
/// gives nothing (or the default); reading continues.
class MapReader {
 public:
  /// Reports a value that is not a map, and each key that the schema does not know.
  MapReader(const Value& map, std::string path, std::vector<std::string> known, FaultList& faults);

  bool has(const std::string& key) const { return map_.find(key) != nullptr; }
  std::string path(const std::string& key) const { return joinPath(path_, key); }

  std::optional<double> number(const std::string& key, const NumberRule& rule) const;
  double number(const std::string& key, const NumberRule& rule, double fallback) const;
  /// A number that may be missing; an invalid one is a fault and counts as missing.
  std::optional<double> optionalNumber(const std::string& key, const NumberRule& rule) const;
  std::optional<long long> integer(const std::string& key, long long lowest,
                                   long long highest) const;
  long long integer(const std::string& key, long long lowest, long long highest,
                    long long fallback) const;
  /// `true` or `false`.
  bool truth(const std::string& key, bool fallback) const;
  /// A text that is not empty; `expected` describes it in the fault.
  std::optional<std::string> text(const std::string& key, const std::string& expected) const;
  /// A list of numbers; `size` of them unless that is 0.
  std::optional<std::vector<double>> numbers(const std::string& key, std::size_t size,
                                             const NumberRule& rule) const;
  /// A word of letters, digits, `_` and `-`: valid as a tf frame and as a key.
  std::optional<std::string> word(const std::string& key) const;
  /// One of a few words.
  std::optional<std::string> choice(const std::string& key,
                                    const std::vector<std::string>& choices) const;
  /// The entries of a list that must hold at least one.
  const std::vector<Value::Entry>* list(const std::string& key) const;
  /// A required value of any kind.
  const Value* required(const std::string& key, const std::string& expected) const;
  /// The one given key out of several; a fault if none or more than one is given.
  std::optional<std::string> exactlyOne(const std::vector<std::string>& keys) const;

  /// Reports `key value; expected rule` at the place of the key.
  void fault(const std::string& key, const std::string& rule) const;
  /// Reports any other fault of a key (or, if it is missing, of the map).
  void complain(const std::string& key, const std::string& fault) const;

 private:
  const Value& map_;
  std::string path_;
  FaultList& faults_;
};

/// The known word that resembles a mistyped one; empty if none does.
std::string nearestWord(const std::string& word, const std::vector<std::string>& known);

/// "a, b or c".
std::string alternatives(const std::vector<std::string>& words);

double radians(double degrees);

/// Fixed-axis roll, pitch, yaw: Rz(yaw) Ry(pitch) Rx(roll), angles in degrees.
Eigen::Matrix3d rotationOfRpyDeg(const Eigen::Vector3d& rpy_deg);

/// The angles [degrees] that rotationOfRpyDeg() turns into this rotation, pitch in [-90, 90].
Eigen::Vector3d rpyDegOf(const Eigen::Matrix3d& R);

/// Three numbers as a vector.
std::optional<Eigen::Vector3d> vector3(const std::optional<std::vector<double>>& numbers);

/// `position_m` and `rpy_deg` of a map; missing or invalid parts are zero.
lie::SE3 readPose(const MapReader& keys, const NumberRule& coordinate);

}  // namespace helix_arm::io
