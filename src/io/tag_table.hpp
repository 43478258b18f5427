#pragma once

#include <Eigen/Core>
#include <map>
#include <string>
#include <utility>
#include <vector>

#include "helix_arm/io/data_set.hpp"
#include "helix_arm/io/fault_list.hpp"

namespace helix_arm::io {

/// A row of a table with one row per tag of each capture.
struct TagRow {
  const DataSet& data;
  int row;
  FaultList& faults;

  int line() const { return data.lines[row]; }
  double operator[](const std::string& column) const { return data.values(row, data.find(column)); }
  /// A whole number >= 0; otherwise -1 and a fault.
  int number(const std::string& column) const;
};

/// @param columns  required besides capture, pressures and tag.
/// @throws DocumentError naming the missing ones.
void requireTagColumns(const DataSet& data, const std::vector<std::string>& columns);

/// The captures of a table in the order in which each appears first.
/// @param readTag  makes a tag, which has an id and a line, from its id and row.
/// @throws DocumentError with all faults.
template <class Capture, class ReadTag>
std::vector<Capture> readTagTable(const DataSet& data, int actuators, ReadTag readTag) {
  const Eigen::MatrixXd pressures = pressuresOf(data, actuators);
  FaultList faults(data.path);
  std::vector<Capture> captures;
  std::map<int, std::size_t> index;
  std::map<std::pair<int, int>, int> lines;  // of each capture and tag
  for (int i = 0; i < data.values.rows(); ++i) {
    const TagRow row{data, i, faults};
    const int number = row.number("capture"), id = row.number("tag");
    if (number < 0 || id < 0) continue;
    const Eigen::VectorXd pressure = pressures.row(i);
    const auto [found, is_new] = index.emplace(number, captures.size());
    if (is_new) captures.push_back({number, pressure, {}});
    Capture& capture = captures[found->second];
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

}  // namespace helix_arm::io
