#include "helix_arm/io/tag_table.hpp"

#include <algorithm>
#include <cmath>
#include <map>
#include <sstream>
#include <utility>

#include "basics/text.hpp"
#include "helix_arm/basics/requirement.hpp"
#include "io/document/number.hpp"

namespace helix_arm::io {
namespace {

// A row of a table with one row per tag of each capture.
struct TagRow {
  const DataSet& data;
  int row;
  FaultList& faults;

  int line() const { return data.lines[row]; }
  double operator[](const std::string& column) const { return data.values(row, data.find(column)); }
  // A whole number >= 0; otherwise -1 and a fault.
  int number(const std::string& column) const {
    constexpr double kMostNumber = 1e9;
    const double value = (*this)[column];
    if (value >= 0 && value <= kMostNumber && value == std::floor(value)) {
      return static_cast<int>(value);
    }
    faults.add(line(), column + " is not a whole number from 0 to " + formatNumber(kMostNumber));
    return -1;
  }
};

// Columns besides those that all tables of tags have.
void requireTagColumns(const DataSet& data, const std::vector<std::string>& columns) {
  std::vector<std::string> all{"capture", "tag"};
  all.insert(all.end(), columns.begin(), columns.end());
  requireColumns(data, all, "capture, pressure_1_kpa .., tag, " + basics::joined(columns));
}

// The captures of a table in the order in which each appears first.
// @param readTag  makes a tag, which has an id and a line, from its id and row.
// @throws DocumentError with all faults.
template <class Tag, class ReadTag>
std::vector<TagCapture<Tag>> readTagTable(const DataSet& data, int actuators, ReadTag readTag) {
  const Eigen::MatrixXd pressures = pressuresOf(data, actuators);
  const int time = data.find("time_s");
  FaultList faults(data.path);
  std::vector<TagCapture<Tag>> captures;
  std::map<int, std::size_t> index;
  std::map<std::pair<int, int>, int> lines;  // of each capture and tag
  for (int i = 0; i < data.values.rows(); ++i) {
    const TagRow row{data, i, faults};
    const int number = row.number("capture"), id = row.number("tag");
    if (number < 0 || id < 0) continue;
    const Eigen::VectorXd pressure = pressures.row(i);
    const auto [found, is_new] = index.emplace(number, captures.size());
    if (is_new) captures.push_back({number, pressure, {}});
    TagCapture<Tag>& capture = captures[found->second];
    if (is_new && time >= 0) capture.time = data.values(i, time);
    if (capture.pressure != pressure) {
      faults.add(row.line(), "has other pressures than its capture; expected those of line " +
                                 std::to_string(capture.tags.front().line));
    }
    const auto [same, is_first] = lines.emplace(std::make_pair(number, id), row.line());
    if (is_first) {
      capture.tags.push_back(readTag(id, row));
    } else {
      faults.add(row.line(), "measures the tag of line " + std::to_string(same->second) +
                                 " again in the same capture; expected it once");
    }
  }
  faults.throwIfAny();
  return captures;
}

constexpr double kNormTolerance = 1e-2;  // rounding to two digits

lie::SE3 readPoseCells(const TagRow& at) {
  const Eigen::Quaterniond q(at["qw"], at["qx"], at["qy"], at["qz"]);
  return {rotationOf(q, at.line(), at.faults), {at["x_m"], at["y_m"], at["z_m"]}};
}

const std::vector<std::string> kPoseColumns = {"x_m", "y_m", "z_m", "qx", "qy", "qz", "qw"};

// @param columns  after that of the tag. @param numbersOf  a tag's values of these.
template <class Tag, class NumbersOf>
std::string tableText(const std::vector<TagCapture<Tag>>& captures, int actuators,
                      const std::string& comment, const std::vector<std::string>& columns,
                      const NumbersOf& numbersOf) {
  std::ostringstream text;
  std::istringstream lines(comment);
  for (std::string line; std::getline(lines, line);) text << "# " << line << "\n";
  const bool has_times = !captures.empty() &&
                         std::all_of(captures.begin(), captures.end(),
                                     [](const auto& capture) { return capture.time.has_value(); });
  text << (has_times ? "capture,time_s" : "capture");
  for (int i = 1; i <= actuators; ++i) text << ",pressure_" << i << "_kpa";
  text << ",tag";
  for (const std::string& column : columns) text << "," << column;
  text << "\n";
  for (const TagCapture<Tag>& capture : captures) {
    basics::require(capture.pressure.size() == actuators, "table of tags: capture ", capture.number,
                    " has ", capture.pressure.size(), " pressures; expected ", actuators);
    for (const auto& tag : capture.tags) {
      text << capture.number;
      if (has_times) text << "," << formatNumber(*capture.time);
      for (const double pressure : capture.pressure) {
        text << "," << formatNumber(kilopascals(pressure));
      }
      text << "," << tag.id;
      for (const double number : numbersOf(tag)) text << "," << formatNumber(number);
      text << "\n";
    }
  }
  return text.str();
}

std::vector<std::string> cornerColumns() {
  std::vector<std::string> columns;
  for (int i = 1; i <= estimation::Corners::ColsAtCompileTime; ++i) {
    for (const char* axis : {"x", "y"}) columns.push_back(axis + std::to_string(i) + "_px");
  }
  return columns;
}

}  // namespace

Eigen::Matrix3d rotationOf(const Eigen::Quaterniond& q, int line, FaultList& faults) {
  if (std::abs(q.norm() - 1) <= kNormTolerance) return q.normalized().toRotationMatrix();
  faults.add(line, "has a quaternion qx, qy, qz, qw that is not of norm 1");
  return Eigen::Matrix3d::Identity();
}

std::vector<TagPoseCapture> loadTagPoses(const DataSet& data, int actuators, const lie::SE3& X_BF) {
  requireTagColumns(data, kPoseColumns);
  return readTagTable<TagPose>(data, actuators, [&X_BF](int id, const TagRow& row) {
    return TagPose{id, X_BF * readPoseCells(row), row.line()};
  });
}

std::vector<TagCornerCapture> loadTagCorners(const DataSet& data, int actuators) {
  const std::vector<std::string> columns = cornerColumns();
  requireTagColumns(data, columns);
  return readTagTable<TagCorners>(data, actuators, [&columns](int id, const TagRow& row) {
    TagCorners tag{id, {}, row.line()};
    for (int i = 0; i < tag.corners.size(); ++i) tag.corners(i) = row[columns[i]];
    return tag;
  });
}

std::string tagCornerCsv(const std::vector<TagCornerCapture>& captures, int actuators,
                         const std::string& comment) {
  return tableText(captures, actuators, comment, cornerColumns(),
                   [](const TagCorners& tag) { return tag.corners.reshaped(); });
}

std::string tagPoseCsv(const std::vector<TagPoseCapture>& captures, int actuators,
                       const std::string& comment) {
  return tableText(captures, actuators, comment, kPoseColumns, [](const TagPose& tag) {
    const Eigen::Quaterniond q(tag.X_BT.rotation);
    Eigen::Matrix<double, 7, 1> out;
    out << tag.X_BT.translation, q.coeffs();
    return out;
  });
}

}  // namespace helix_arm::io
