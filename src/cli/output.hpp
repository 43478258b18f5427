#pragma once

#include <Eigen/Core>
#include <functional>
#include <iosfwd>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "command.hpp"
#include "helix_arm/calibration/suspects.hpp"
#include "helix_arm/model/arm.hpp"
#include "helix_arm/statics/inverse.hpp"
#include "nlohmann/json.hpp"

namespace helix_arm::cli {

/// {position_m [3], quaternion_xyzw [4]}, the quaternion with w >= 0.
nlohmann::json toJson(const lie::SE3& pose);
nlohmann::json toJson(const Eigen::VectorXd& vector);
/// JSON of a vector of any size, or a row or column of a matrix.
template <class Vector>
nlohmann::json toJson(const Eigen::MatrixBase<Vector>& vector) {
  return toJson(Eigen::VectorXd(vector));
}
/// Row by row.
nlohmann::json rowsJson(const Eigen::MatrixXd& matrix);
/// null where there is none.
nlohmann::json toJson(const std::optional<double>& number);
/// JSON array of the function's results for each of the values.
template <class Values, class JsonOf>
nlohmann::json listJson(const Values& values, const JsonOf& jsonOf) {
  nlohmann::json out = nlohmann::json::array();
  for (const auto& value : values) out.push_back(jsonOf(value));
  return out;
}
/// null where it is NaN or infinite.
nlohmann::json finite(double number);
/// null where it is empty.
nlohmann::json textOrNull(const std::string& text);
/// Null unless finite.
nlohmann::json numberOrNull(double value);
/// [{cause, where, explains, remedy}].
nlohmann::json suspectsJson(const std::vector<estimation::Suspect>& suspects);
/// One array of six a section: [v; w].
nlohmann::json toJson(const model::Twists& twists);

/// Readings in kPa: "muscle_1 12.3 kPa, muscle_2 no reading".
std::string pressureText(const model::Arm& arm, const Eigen::VectorXd& pressure, int decimals = 1);
/// Numbers, null where there is no reading.
nlohmann::json readingsJson(const Eigen::VectorXd& pressure);

/// Adds the inputs: `pressure_pa`, or, where there are tendons, `input` and `input_unit`.
void addInputs(const model::Arm& arm, const Eigen::VectorXd& inputs, nlohmann::json& result);

/// Actuators at their limits: "muscle_1 upper, muscle_3 lower"; empty without any.
/// @param limits  one per actuator.
std::string limitsText(const model::Arm& arm, const std::vector<statics::Limit>& limits);

/// A CSV table under construction: columns with names, rows of numbers with all digits or of words.
class CsvTable {
 public:
  /// A row: the same columns in the same order every time.
  using Row = std::vector<std::pair<std::string, std::string>>;
  CsvTable() = default;
  /// One row.
  CsvTable(Row row) : rows_{std::move(row)} {}  // NOLINT(google-explicit-constructor)
  /// cellsOf() each of the reports.
  CsvTable(const nlohmann::json& reports, const std::vector<const char*>& keys);
  void add(Row row) { rows_.push_back(std::move(row)); }
  void print(std::ostream& out) const;
  /// The names of a row's columns, or its values, as a line.
  static void printNames(const Row& row, std::ostream& out);
  static void printValues(const Row& row, std::ostream& out);

 private:
  std::vector<Row> rows_;
};

/// Values that a report has under these keys: numbers with all digits, true as 1, null as nothing,
/// whole numbers of a list in one cell. Of a list of other numbers each has a column: `pressure_pa`
/// gives pressure_1_pa and so on.
CsvTable::Row cellsOf(const nlohmann::json& report, const std::vector<const char*>& keys);
/// The same as lines "# key value" in front of a table, and the `reason`, where there is one.
void printComments(const nlohmann::json& report, std::vector<const char*> keys);
/// A text in quotes, by RFC 4180.
std::string quotedCell(const std::string& text);

/// A number for csv: reads back as the same.
std::string exact(double value);
/// The same; empty where there is none.
std::string exact(const std::optional<double>& value);
/// Cells `pressure_1_pa` (or `input_2_rad`) and so on.
void appendInputs(const model::Arm& arm, const Eigen::VectorXd& inputs, CsvTable::Row& row);
/// Cells `section_1_vx_m` .. `section_1_wz_rad` and so on, of a `twist`; empty cells where it is
/// null.
void appendTwists(const nlohmann::json& twist, int sections, CsvTable::Row& row);
/// Cells `<prefix>x_m` .. `<prefix>qw`, likewise.
void appendPose(const std::string& prefix, const nlohmann::json& pose, CsvTable::Row& row);

/// Prints the results of a table's rows as they come, so that a long table takes no memory:
/// {scene, rows [..]} as json, or names and a line a row as csv.
class RowPrinter {
 public:
  RowPrinter(Format format, const std::string& scene);
  /// @param where          of the row, for text.
  /// @param report, cells  give the row in each format; they are called where it needs them.
  /// @param shown          keys of the report that text has, on one line.
  void add(const std::string& where, const std::function<nlohmann::json()>& report,
           const std::function<CsvTable::Row()>& cells, const std::vector<const char*>& shown);
  void end();

 private:
  const Format format_;
  bool any_ = false;
};

/// Makes what is written to a stream basics::printableLines() for as long as it exists: the last
/// defence against text from outside that a message repeats unquoted.
class PrintableStream {
 public:
  explicit PrintableStream(std::ostream& stream);
  ~PrintableStream();
  PrintableStream(const PrintableStream&) = delete;
  PrintableStream& operator=(const PrintableStream&) = delete;

 private:
  std::ostream& stream_;
  std::unique_ptr<std::streambuf> filter_;
  std::streambuf* const bare_;
};

/// A result for people: aligned lines and tables, names and units by its keys (text.cpp).
void printText(const nlohmann::json& result, std::ostream& out);
/// The same on one line, without tables.
std::string lineOf(const nlohmann::json& result);
/// A report without keys of any depth: what text leaves to json.
nlohmann::json without(nlohmann::json report, const std::vector<std::string>& keys);

/// Prints a result in the chosen format.
/// @param shown  what text shows instead of the report.
/// @param table  of the result; called for csv alone.
void printResult(Format format, const nlohmann::json& report, const nlohmann::json& shown,
                 const std::function<CsvTable()>& table);

/// Checks the file of --png, which may be empty, before work that takes long.
/// @param out  the file of --out, may be empty.
/// @throws CallerError if both are the same file, io::FileError if the picture cannot be written.
void checkPicture(const std::string& png, const std::string& out);

}  // namespace helix_arm::cli
