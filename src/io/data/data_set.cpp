#include "helix_arm/io/data_set.hpp"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <map>
#include <regex>
#include <string_view>
#include <utility>
#include <variant>

#include "helix_arm/basics/requirement.hpp"
#include "helix_arm/basics/text.hpp"
#include "helix_arm/io/atomic_file.hpp"
#include "helix_arm/io/fault_list.hpp"
#include "helix_arm/io/number.hpp"
#include "io/document/document.hpp"

namespace helix_arm::io {

namespace {

const char* const kNames[] = {"capture", "tag",   "curvature_rad", "pressure_kpa", "length_m",
                              "x_m",     "y_m",   "z_m",           "qx",           "qy",
                              "qz",      "qw",    "x1_px",         "y1_px",        "x2_px",
                              "y2_px",   "x3_px", "y3_px",         "x4_px",        "y4_px",
                              "time_s",  "trial"};
const char* const kTrial = "trial";

// pressure_1_kpa, pressure_999_pa, and in units that no table has: pressure_1_psi
bool isPressure(const std::string& name) {
  static const std::regex form("pressure_[0-9]{1,3}_([km]?pa|m?bar|psi)");
  return std::regex_match(name, form);
}

// Name of a table's column in messages: its own if it is a known one (curvature_rad,
// pressure_1_kpa, ..), otherwise its number from 1 ("column 3"), so that messages do not repeat
// the content of files that are not data sets.
std::string columnText(const std::vector<std::string>& columns, std::size_t index) {
  const std::string& name = columns[index];
  const bool ours =
      isPressure(name) || std::find(std::begin(kNames), std::end(kNames), name) != std::end(kNames);
  return ours ? name : "column " + std::to_string(index + 1);
}

constexpr double kLargest = 1e300;         // stays finite in any unit
constexpr std::size_t kManyFaults = 1000;  // the file is of another kind; more faults help nobody

// The memory of a table, and of everything derived from it, is a small multiple of these.
constexpr std::size_t kMostRows = 200'000;
constexpr std::size_t kMostColumns = 1000;
constexpr std::size_t kMostCells = 4'000'000;
constexpr std::size_t kLongestName = 200;
constexpr std::size_t kLongestCell = 1000;

std::string_view trimmed(std::string_view text) {
  constexpr const char* kBlanks = " \t\r";
  const std::size_t first = text.find_first_not_of(kBlanks);
  if (first == std::string_view::npos) return {};
  return text.substr(first, text.find_last_not_of(kBlanks) - first + 1);
}

std::size_t cellCount(std::string_view line) {
  return static_cast<std::size_t>(std::count(line.begin(), line.end(), ',')) + 1;
}

// Removes the first cell of a line and its comma.
std::string_view takeCell(std::string_view& line) {
  const std::size_t end = line.find(',');
  const std::string_view cell = trimmed(line.substr(0, end));
  line.remove_prefix(end == std::string_view::npos ? line.size() : end + 1);
  return cell;
}

std::string atMost(std::size_t found, const char* what, std::size_t most) {
  return basics::messageOf("has ", found, what, "; expected at most ", most);
}

// Reads the lines of one table.
class TableReader {
 public:
  TableReader(DataSet& data, FaultList& faults, const std::vector<std::string>& skipped)
      : data_(data), faults_(faults), skipped_(skipped) {}

  void read(std::string_view text) {
    for (int line = 1; !text.empty() && !full_; ++line) {
      const std::size_t end = text.find('\n');
      const std::string_view content = trimmed(text.substr(0, end));
      text.remove_prefix(end == std::string_view::npos ? text.size() : end + 1);
      if (content.empty() || content.front() == '#') continue;
      data_.columns.empty() ? readHeader(content, line) : readRow(content, line);
      full_ = full_ || faults_.count() > kManyFaults;
    }
    if (full_) return;
    if (data_.columns.empty()) faults_.add(0, "has no header; expected a line of column names");
    if (!data_.columns.empty() && rows_ == 0)
      faults_.add(0, "has no rows; expected at least one below the header");
  }

  /// Of a table without faults.
  void takeValues() {
    using Rows = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
    std::vector<std::string> names;
    for (std::size_t i = 0; i < data_.columns.size(); ++i) {
      if (!skips_[i]) names.push_back(std::move(data_.columns[i]));
    }
    data_.columns = std::move(names);
    data_.values = Eigen::Map<const Rows>(cells_.data(), static_cast<int>(rows_),
                                          static_cast<int>(data_.columns.size()));
  }

 private:
  template <class... Parts>
  void complain(int line, const Parts&... fault) {
    faults_.add(line, basics::messageOf(fault...));
  }
  template <class... Parts>
  void refuse(int line, const Parts&... fault) {
    complain(line, fault...);
    full_ = true;
  }

  void readHeader(std::string_view content, int line) {
    const std::size_t count = cellCount(content);
    if (count > kMostColumns) return refuse(line, atMost(count, " columns", kMostColumns));
    for (std::size_t i = 0; i < count; ++i) {
      const std::string_view name = takeCell(content);
      if (name.size() > kLongestName) {
        return refuse(line, "column ", i + 1, " ",
                      atMost(name.size(), " characters in its name", kLongestName));
      }
      data_.columns.emplace_back(name);
      skips_.push_back(std::find(skipped_.begin(), skipped_.end(), name) != skipped_.end());
    }
    checkNames(line);
  }

  void checkNames(int line) {
    std::map<std::string, std::size_t> seen;
    for (std::size_t i = 0; i < data_.columns.size(); ++i) {
      if (data_.columns[i].empty()) {
        complain(line, "column ", i + 1, " has no name; expected one with its unit");
        continue;
      }
      const auto [first, is_new] = seen.emplace(data_.columns[i], i);
      if (is_new) continue;
      complain(line, "column ", i + 1, " has the name of column ", first->second + 1,
               "; expected each name once");
    }
  }

  void readRow(std::string_view content, int line) {
    if (rows_ == kMostRows) {
      return refuse(line, "is row ", rows_ + 1, "; expected at most ", kMostRows,
                    " rows: split the file");
    }
    const std::size_t columns = data_.columns.size();
    if ((rows_ + 1) * columns > kMostCells) {
      return refuse(line, "is row ", rows_ + 1, " of ", columns, " columns; expected at most ",
                    kMostCells, " cells: split the file");
    }
    ++rows_;
    data_.lines.push_back(line);
    const std::size_t count = cellCount(content);
    if (count != columns) {
      return complain(line, "has ", count, " cells; expected ", columns, ", one per column");
    }
    for (std::size_t i = 0; i < columns; ++i) {
      const std::string_view cell = takeCell(content);
      if (skips_[i]) continue;
      const Cell read = data_.columns[i] == kTrial ? trialOf(cell) : numberOf(cell);
      cells_.push_back(std::holds_alternative<double>(read) ? std::get<double>(read) : 0.0);
      if (const auto* fault = std::get_if<std::string>(&read)) {
        complain(line, columnText(data_.columns, i), " ", *fault);
      }
    }
  }

  // The value of a cell, or its fault.
  using Cell = std::variant<double, std::string>;

  Cell trialOf(std::string_view cell) {
    if (cell.empty()) return "is empty; expected a name";
    if (cell.size() > kLongestName) return atMost(cell.size(), " characters", kLongestName);
    const auto [trial, is_new] = trials_.emplace(cell, trials_.size());
    if (is_new) data_.trials.emplace_back(cell);
    return static_cast<double>(trial->second);
  }

  Cell numberOf(std::string_view cell) {
    if (cell.empty()) return "is empty; expected a finite number";
    if (cell.size() > kLongestCell) return atMost(cell.size(), " characters", kLongestCell);
    cell_.assign(cell);
    const std::optional<double> number = parseNumber(cell_);
    if (!number) return "is not a finite number; expected one";
    if (std::abs(*number) <= kLargest) return *number;
    return "is too large; expected at most " + formatNumber(kLargest);
  }

  DataSet& data_;
  FaultList& faults_;
  const std::vector<std::string>& skipped_;
  std::vector<bool> skips_;                    // a column
  std::vector<double> cells_;                  // in row order, without the skipped columns
  std::map<std::string, std::size_t> trials_;  // by their names
  std::size_t rows_ = 0;
  std::string cell_;
  bool full_ = false;  // the rest is not read
};

// @param content  nothing after a fault.
DataSet parsed(const std::string& name, const std::optional<std::string>& content,
               FaultList& faults, const std::vector<std::string>& skipped) {
  faults.throwIfAny();
  std::string_view text = *content;
  const std::string_view byte_order_mark = "\xEF\xBB\xBF";  // written by spreadsheets
  if (text.substr(0, byte_order_mark.size()) == byte_order_mark) {
    text.remove_prefix(byte_order_mark.size());
  }
  DataSet data;
  data.path = name;
  data.sha256 = sha256Of(*content);
  TableReader reader(data, faults, skipped);
  reader.read(text);
  faults.throwIfAny();
  reader.takeValues();
  return data;
}

}  // namespace

int DataSet::find(const std::string& column) const {
  const auto found = std::find(columns.begin(), columns.end(), column);
  return found == columns.end() ? -1 : static_cast<int>(found - columns.begin());
}

void requireColumns(const DataSet& data, const std::vector<std::string>& columns,
                    const std::string& expected) {
  std::vector<std::string> missing;
  std::copy_if(columns.begin(), columns.end(), std::back_inserter(missing),
               [&data](const std::string& column) { return data.find(column) < 0; });
  if (missing.empty()) return;
  FaultList faults(data.path);
  faults.add(0, "has no column " + basics::joined(missing) + "; expected " + expected);
  faults.throwIfAny();
}

DataSet loadDataSet(const std::string& path, const std::vector<std::string>& skipped) {
  FaultList faults(path);
  return parsed(path, readTextFile(path, kMostTableBytes, faults), faults, skipped);
}

DataSet readDataSet(std::istream& in, const std::string& name,
                    const std::vector<std::string>& skipped) {
  FaultList faults(name);
  return parsed(name, readTextStream(in, kMostTableBytes, faults), faults, skipped);
}

Eigen::MatrixXd pressuresOf(const DataSet& data, int actuators) {
  const std::string prefix = "pressure_";
  const auto nameOf = [&prefix](int actuator, const char* unit) {
    return prefix + std::to_string(actuator + 1) + unit;
  };
  const std::string expected = nameOf(0, "_kpa") + " to " + nameOf(actuators - 1, "_kpa");

  FaultList faults(data.path);
  Eigen::MatrixXd pressures = Eigen::MatrixXd::Zero(data.values.rows(), actuators);
  std::vector<bool> ours(data.columns.size());
  for (int i = 0; i < actuators; ++i) {
    const int kpa = data.find(nameOf(i, "_kpa")), pa = data.find(nameOf(i, "_pa"));
    if (kpa >= 0 && pa >= 0) {
      faults.add(0, nameOf(i, "_pa") + " stands beside " + nameOf(i, "_kpa") + "; expected one");
    }
    if (pa >= 0) pressures.col(i) = data.values.col(pa);
    if (kpa >= 0) pressures.col(i) = data.values.col(kpa).unaryExpr(&pascals);
    for (const int column : {kpa, pa}) {
      if (column >= 0) ours[static_cast<std::size_t>(column)] = true;
    }
  }
  bool any = false;
  for (std::size_t i = 0; i < data.columns.size(); ++i) {
    if (data.columns[i].compare(0, prefix.size(), prefix) != 0) continue;
    any = true;
    if (ours[i]) continue;
    faults.add(0, columnText(data.columns, i) + " belongs to no actuator; expected pressures in " +
                      expected);
  }
  if (!any) faults.add(0, "has no pressures; expected columns " + expected);
  faults.throwIfAny();
  return pressures;
}

model::InputHistory historyOf(const DataSet& data, int actuators) {
  return historyOf(data, pressuresOf(data, actuators));
}

model::InputHistory historyOf(const DataSet& data, Eigen::MatrixXd pressure) {
  model::InputHistory history;
  history.input = std::move(pressure);
  const int time = data.find("time_s"), trial = data.find("trial");
  FaultList faults(data.path);
  for (Eigen::Index row = 0; row < data.values.rows(); ++row) {
    const bool first =
        row == 0 || (trial >= 0 && data.values(row, trial) != data.values(row - 1, trial));
    history.starts_anew.push_back(first);
    if (time < 0) continue;
    history.time.push_back(data.values(row, time));
    if (first || data.values(row, time) >= data.values(row - 1, time)) continue;
    faults.add(data.lines[static_cast<std::size_t>(row)],
               "time_s goes back; expected times that do not fall, or another trial");
  }
  faults.throwIfAny();
  return history;
}

}  // namespace helix_arm::io
