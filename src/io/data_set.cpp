#include "helix_arm/io/data_set.hpp"

#include <algorithm>
#include <cmath>
#include <set>
#include <sstream>

#include "helix_arm/io/fault_list.hpp"
#include "helix_arm/io/number.hpp"
#include "text_file.hpp"

namespace helix_arm::io {
namespace {

constexpr double kLargest = 1e300;         // no change of units makes it infinite
constexpr std::size_t kManyFaults = 1000;  // a file of quite another kind; nobody reads further

std::string trimmed(const std::string& text) {
  const char* blanks = " \t\r";
  const std::size_t first = text.find_first_not_of(blanks);
  if (first == std::string::npos) return {};
  return text.substr(first, text.find_last_not_of(blanks) - first + 1);
}

std::vector<std::string> cellsOf(const std::string& line) {
  std::vector<std::string> cells;
  std::size_t begin = 0;
  for (std::size_t end = 0; end != std::string::npos; begin = end + 1) {
    end = line.find(',', begin);
    cells.push_back(trimmed(line.substr(begin, end == std::string::npos ? end : end - begin)));
  }
  return cells;
}

void checkHeader(const std::vector<std::string>& columns, int line, FaultList& faults) {
  std::set<std::string> seen;
  for (std::size_t i = 0; i < columns.size(); ++i) {
    if (columns[i].empty()) {
      faults.add(line,
                 "column " + std::to_string(i + 1) + " has no name; expected one with its unit");
    } else if (!seen.insert(columns[i]).second) {
      faults.add(line, "column " + columns[i] + " is named twice; expected it once");
    }
  }
}

std::vector<double> readRow(const std::vector<std::string>& cells,
                            const std::vector<std::string>& columns, int line, FaultList& faults) {
  std::vector<double> row;
  if (cells.size() != columns.size()) {
    faults.add(line, "has " + std::to_string(cells.size()) + " cells; expected " +
                         std::to_string(columns.size()) + ", one for each column");
    return row;
  }
  for (std::size_t i = 0; i < cells.size(); ++i) {
    const std::optional<double> number = parseNumber(cells[i]);
    if (!number) {
      faults.add(line, columns[i] + " is " + (cells[i].empty() ? "empty" : cells[i]) +
                           "; expected a finite number");
    } else if (std::abs(*number) > kLargest) {
      faults.add(line, columns[i] + " is " + cells[i] + "; expected a number of at most " +
                           formatNumber(kLargest));
    }
    row.push_back(number.value_or(0.0));
  }
  return row;
}

std::string unknownColumn(const std::string& column, const std::string& expected) {
  return "has a column " + column + "; expected pressures in " + expected;
}

}  // namespace

int DataSet::find(const std::string& column) const {
  const auto found = std::find(columns.begin(), columns.end(), column);
  return found == columns.end() ? -1 : static_cast<int>(found - columns.begin());
}

DataSet loadDataSet(const std::string& path) {
  FaultList faults(path);
  std::optional<std::string> content = readTextFile(path, faults);
  faults.throwIfAny();
  const std::string byte_order_mark = "\xEF\xBB\xBF";  // spreadsheets put it first
  if (content->compare(0, byte_order_mark.size(), byte_order_mark) == 0) {
    content->erase(0, byte_order_mark.size());
  }

  DataSet data;
  data.path = path;
  std::vector<std::vector<double>> rows;
  std::istringstream stream(*content);
  std::string text;
  for (int line = 1; std::getline(stream, text); ++line) {
    text = trimmed(text);
    if (text.empty() || text.front() == '#') continue;
    if (data.columns.empty()) {
      data.columns = cellsOf(text);
      checkHeader(data.columns, line, faults);
      continue;
    }
    rows.push_back(readRow(cellsOf(text), data.columns, line, faults));
    data.lines.push_back(line);
    if (faults.faults().size() > kManyFaults) break;
  }
  if (data.columns.empty()) faults.add(0, "has no header; expected a line of column names");
  if (!data.columns.empty() && rows.empty())
    faults.add(0, "has no rows; expected at least one below the header");
  faults.throwIfAny();

  data.values.resize(static_cast<int>(rows.size()), static_cast<int>(data.columns.size()));
  for (int i = 0; i < data.values.rows(); ++i) {
    data.values.row(i) = Eigen::Map<const Eigen::RowVectorXd>(rows[i].data(), data.values.cols());
  }
  return data;
}

Eigen::MatrixXd pressuresOf(const DataSet& data, int actuators) {
  const std::string prefix = "pressure_";
  std::vector<std::string> names;
  for (int i = 1; i <= actuators; ++i) names.push_back("pressure_" + std::to_string(i) + "_kpa");
  const std::string expected = names.front() + " to " + names.back();

  FaultList faults(data.path);
  bool any = false;
  for (const std::string& column : data.columns) {
    if (column.compare(0, prefix.size(), prefix) != 0) continue;
    if (std::find(names.begin(), names.end(), column) == names.end()) {
      faults.add(0, unknownColumn(column, expected));
    }
    any = true;
  }
  if (!any) faults.add(0, "has no pressures; expected columns " + expected);
  faults.throwIfAny();

  Eigen::MatrixXd pressures = Eigen::MatrixXd::Zero(data.values.rows(), actuators);
  for (int i = 0; i < actuators; ++i) {
    const int column = data.find(names[i]);
    if (column >= 0) pressures.col(i) = data.values.col(column).unaryExpr(&pascals);
  }
  return pressures;
}

}  // namespace helix_arm::io
