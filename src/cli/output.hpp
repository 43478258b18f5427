#pragma once

#include <Eigen/Core>
#include <cmath>
#include <functional>
#include <iosfwd>
#include <optional>
#include <string>
#include <type_traits>
#include <utility>
#include <vector>

#include "helix_arm/calibration/suspects.hpp"
#include "helix_arm/model/arm.hpp"
#include "helix_arm/statics/inverse.hpp"
#include "nlohmann/json.hpp"

// A result is one report in JSON. It is printed as it is, for people by the names and units of its
// keys (text.cpp), or as csv by a list of its keys. Values of the library stand in it as they are.

namespace nlohmann {

/// A vector is a list, a matrix a list of its rows; null where a number is not finite.
template <class Dense>
struct adl_serializer<Dense, std::enable_if_t<std::is_base_of_v<Eigen::DenseBase<Dense>, Dense>>> {
  static void to_json(json& out, const Dense& values) {
    out = json::array();
    for (Eigen::Index i = 0; i < values.rows(); ++i) {
      if constexpr (Dense::ColsAtCompileTime == 1) {
        const bool finite = std::isfinite(static_cast<double>(values(i, 0)));
        out.push_back(finite ? json(values(i, 0)) : json());
      } else if constexpr (Dense::RowsAtCompileTime == 1) {
        out = values.transpose().eval();
      } else {
        out.push_back(values.row(i).transpose().eval());
      }
    }
  }
};

/// null where there is none.
template <class Value>
struct adl_serializer<std::optional<Value>> {
  static void to_json(json& out, const std::optional<Value>& value) {
    out = value ? json(*value) : json();
  }
};

/// {position_m [3], quaternion_xyzw [4]}, the quaternion with w >= 0.
template <>
struct adl_serializer<helix_arm::lie::SE3> {
  static void to_json(json& out, const helix_arm::lie::SE3& pose);
};

/// {cause, where, explains, remedy}
template <>
struct adl_serializer<helix_arm::estimation::Suspect> {
  static void to_json(json& out, const helix_arm::estimation::Suspect& suspect);
};

}  // namespace nlohmann

namespace helix_arm::cli {

using nlohmann::json;

/// JSON array of the function's results for each of the values.
template <class Values, class JsonOf>
json listJson(const Values& values, const JsonOf& jsonOf) {
  json out = json::array();
  for (const auto& value : values) out.push_back(jsonOf(value));
  return out;
}
/// null where it is empty.
json textOrNull(const std::string& text);
/// null where it is not wanted.
template <class Value>
json valueIf(bool wanted, const Value& value) {
  return wanted ? json(value) : json();
}

/// Readings in kPa: "muscle_1 12.3 kPa, muscle_2 no reading".
std::string pressureText(const model::Arm& arm, const Eigen::VectorXd& pressure, int decimals = 1);

/// Adds `actuators` and their inputs: `pressure_pa`, or, where there are tendons, `input` and
/// `input_unit`.
void addInputs(const model::Arm& arm, const Eigen::VectorXd& inputs, json& result);

/// Actuators at their limits: "muscle_1 upper, muscle_3 lower"; empty without any.
/// @param limits  one per actuator, or none.
std::string limitsText(const model::Arm& arm, const std::vector<statics::Limit>& limits);

/// A number for csv: reads back as the same.
std::string exact(double value);

/// A value of a report in csv: one column, or one for each number of a list or an object.
struct Column {
  /// @param key_  may lead into objects: "missing/force_n"; "inputs" stands for those of
  /// addInputs().
  Column(const char* key_) : key(key_) {}         // NOLINT(google-explicit-constructor)
  Column(const std::string& key_) : key(key_) {}  // NOLINT(google-explicit-constructor)
  /// @param name_  of the columns; * stands for 1, 2 .., @ for x, y, z, w.
  Column(const std::string& key_, const std::string& name_) : key(key_), name(name_) {}

  std::string key, name;
};
using Columns = std::vector<Column>;

/// A table of csv that is written row by row: numbers with all digits, true as 1, null as nothing,
/// whole numbers of a list in one cell. `pressure_pa` gives pressure_1_pa and so on; a pose tip_x_m
/// .. tip_qw; `twist` section_1_vx_m ..; `covariance` its upper triangle. These keep their columns
/// where they are null.
class CsvTable {
 public:
  /// @param arm  for inputs, twists and covariances.
  CsvTable(std::ostream& out, Columns columns, const model::Arm* arm = nullptr)
      : out_(out), columns_(std::move(columns)), arm_(arm) {}
  /// Adds a row, the first one below the names of its columns.
  void add(const json& report);

 private:
  std::ostream& out_;
  const Columns columns_;
  const model::Arm* const arm_;
  bool named_ = false;
};

/// The csv of a report.
struct Csv {
  Columns columns;
  std::string rows = {};  ///< key of a list whose entries are the rows; empty: one row, the report
  std::vector<const char*> comments = {};  ///< keys of lines "# key value" above it, unless null
  const model::Arm* arm = nullptr;
};
void printCsv(const json& report, const Csv& csv, std::ostream& out);
/// The same as a file has it, below lines of comment.
std::string csvText(const std::string& comment, const json& report, const Csv& csv);

enum class Format { kText, kJson, kCsv };

/// Prints a result in the chosen format.
/// @param shown  what text shows instead of the report.
/// @param csv    called for csv alone.
void printResult(Format format, const json& report, const json& shown,
                 const std::function<void(std::ostream&)>& csv);
void printResult(Format format, const json& report, const json& shown, const Csv& csv);

/// Prints the results of a table's rows as they come, so that a long table takes no memory:
/// {scene, rows [..]} as json, or names and a line a row as csv.
class RowPrinter {
 public:
  /// @param shown  keys of a row that text has, on one line.
  RowPrinter(Format format, const std::string& scene, const CsvTable& table,
             std::vector<const char*> shown);
  /// @param where  of the row, for text.
  void add(const std::string& where, const json& report);
  void end();

 private:
  const Format format_;
  CsvTable table_;
  const std::vector<const char*> shown_;
  bool any_ = false;
};

/// A result for people: aligned lines and tables, names and units by its keys (text.cpp).
void printText(const json& result, std::ostream& out);
/// The same on one line, without tables.
std::string lineOf(const json& result);
/// A report without keys of any depth: what text leaves to json.
json without(json report, const std::vector<std::string>& keys);

}  // namespace helix_arm::cli
