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
#include "helix_arm/model/arm.hpp"
#include "helix_arm/statics/tier.hpp"
#include "nlohmann/json.hpp"

namespace helix_arm::cli {

/// {position_m [3], quaternion_xyzw [4]}, the quaternion with w >= 0.
nlohmann::json toJson(const lie::SE3& pose);
nlohmann::json toJson(const Eigen::VectorXd& vector);
/// Row by row.
nlohmann::json rowsJson(const Eigen::MatrixXd& matrix);
/// null where there is none.
nlohmann::json toJson(const std::optional<double>& number);
/// One array of six a section: [v; w].
nlohmann::json toJson(const model::Twists& twists);

/// Adds the inputs: `pressure_pa`, or, where there are tendons, `input` and `input_unit`.
void addInputs(const model::Arm& arm, const Eigen::VectorXd& inputs, nlohmann::json& result);

/// x, y, z, w of a rotation, w >= 0.
Eigen::Vector4d quaternionXyzw(const Eigen::Matrix3d& rotation);

/// A CSV table under construction: columns with names, rows of numbers with all digits or of words.
class CsvTable {
 public:
  /// A row: the same columns in the same order every time.
  using Row = std::vector<std::pair<std::string, std::string>>;
  void add(const Row& row) { rows_.push_back(row); }
  void print(std::ostream& out) const;
  /// The names of a row's columns, or its values, as a line.
  static void printNames(const Row& row, std::ostream& out);
  static void printValues(const Row& row, std::ostream& out);

 private:
  std::vector<Row> rows_;
};

/// A number for csv: reads back as the same.
std::string exact(double value);
/// The same; empty where there is none.
std::string exact(const std::optional<double>& value);
/// The order of the loaded tier; empty of the others.
std::string orderCell(const statics::TierSetting& setting);
/// Cells `pressure_1_pa` (or `input_2_rad`) and so on.
void appendInputs(const model::Arm& arm, const Eigen::VectorXd& inputs, CsvTable::Row& row);
/// Cells `section_1_vx_m` .. `section_1_wz_rad` and so on.
void appendTwists(const model::Twists& twists, CsvTable::Row& row);
/// Cells `<prefix>x_m` .. `<prefix>qw`.
void appendPose(const std::string& prefix, const lie::SE3& pose, CsvTable::Row& row);

/// "[1.000000, 2.000000]" for people.
std::string bracketed(const Eigen::VectorXd& vector);
/// "position [..] m, quaternion xyzw [..]" for people.
std::string poseText(const lie::SE3& pose);

/// Prints the results of a table's rows as they come, so that a long table takes no memory:
/// {scene, rows [..]} as json, or names and a line a row as csv.
class RowPrinter {
 public:
  /// @param format  json or csv; of text nothing is printed.
  RowPrinter(Format format, const std::string& scene);
  /// @param report, cells  give the row in each format; only that of the chosen one is called.
  void add(const std::function<nlohmann::json()>& report,
           const std::function<CsvTable::Row()>& cells);
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

/// Prints a JSON document.
void printJson(const nlohmann::json& result);

/// Has plot_report draw a report as a picture: see procedures::drawReportText().
void drawJsonReport(const nlohmann::json& report, const std::string& picture,
                    const std::string& without);

/// Checks the file of --png, which may be empty, before work that takes long.
/// @param out  the file of --out, may be empty.
/// @throws CallerError if both are the same file, io::FileError if the picture cannot be written.
void checkPicture(const std::string& png, const std::string& out);

}  // namespace helix_arm::cli
