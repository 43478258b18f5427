#include "helix_arm/io/data_set.hpp"

#include <algorithm>
#include <cctype>
#include <cmath>
#include <deque>
#include <iterator>
#include <map>
#include <regex>
#include <string_view>
#include <utility>
#include <variant>

#include "basics/quote.hpp"
#include "basics/text.hpp"
#include "helix_arm/basics/requirement.hpp"
#include "helix_arm/io/fault_list.hpp"
#include "io/document/atomic_file.hpp"
#include "io/document/document.hpp"
#include "io/document/map_reader.hpp"
#include "io/document/number.hpp"

namespace helix_arm::io {

namespace {

const char* const kNames[] = {"capture",
                              "tag",
                              "curvature_rad",
                              "pressure_kpa",
                              "length_m",
                              "force_n",
                              "x_m",
                              "y_m",
                              "z_m",
                              "qx",
                              "qy",
                              "qz",
                              "qw",
                              "x1_px",
                              "y1_px",
                              "x2_px",
                              "y2_px",
                              "x3_px",
                              "y3_px",
                              "x4_px",
                              "y4_px",
                              "time_s",
                              "trial",
                              "seen",
                              "load_mass_kg",
                              "load_force_x_n",
                              "load_force_y_n",
                              "load_force_z_n",
                              "load_s"};
const char* const kTrial = "trial";
const char* const kSeen = "seen";
// Columns without a value where `seen` is 0.
const char* const kMeasured[] = {"x_m", "y_m", "z_m", "qx", "qy", "qz", "qw"};

template <class Names>
bool isAmong(const std::string& name, const Names& names) {
  return std::find(std::begin(names), std::end(names), name) != std::end(names);
}

// pressure_1_kpa, pressure_999_pa, and in units that no table has: pressure_1_psi
bool isPressure(const std::string& name) {
  static const std::regex form("pressure_[0-9]{1,3}_([km]?pa|m?bar|psi)");
  return name.compare(0, 9, "pressure_") == 0 && std::regex_match(name, form);
}

// Columns that some command reads: their cells must be numbers.
bool isKnown(const std::string& name) {
  if (name.empty() || std::isalpha(static_cast<unsigned char>(name.front())) == 0) return false;
  static const std::regex printed("input_[0-9]+|angle_[0-9]+_rad|tip_([xyz]_m|q[xyzw])");
  return isPressure(name) || isAmong(name, kNames) || std::regex_match(name, printed);
}

// ---- Names that nearly are those of known columns ----

// Letters and digits of a name, in lower case.
std::string bare(const std::string& name) {
  std::string out;
  for (const char c : name) {
    const auto byte = static_cast<unsigned char>(c);
    if (std::isalnum(byte) != 0) out += static_cast<char>(std::tolower(byte));
  }
  return out;
}

std::string digitsOf(const std::string& word) {
  std::string out;
  std::copy_if(word.begin(), word.end(), std::back_inserter(out),
               [](unsigned char c) { return std::isdigit(c) != 0; });
  return out;
}

// Whether a bare name is a known one in another spelling or with another unit or none.
bool resembles(const std::string& word, const std::string& known) {
  constexpr std::size_t kLong = 6;  // letters of words in which one may be wrong, or two exchanged
  const std::string other = bare(known);
  if (word == other) return true;
  // length_1_m, which inverse prints, is another quantity than length_m.
  if (word.empty() || word.front() != other.front() || digitsOf(word) != digitsOf(other)) {
    return false;
  }
  const std::size_t wrong = other.size() < kLong ? 9 : editDistance(word, other);
  if (wrong <= 1) return true;
  const bool same_letters =
      word.size() == other.size() && std::is_permutation(word.begin(), word.end(), other.begin());
  if (wrong == 2 && same_letters) return true;
  const std::size_t unit = known.rfind('_');
  if (unit == std::string::npos) return false;
  const std::string stem = bare(known.substr(0, unit));
  if (word.compare(0, stem.size(), stem) != 0) return false;
  static const std::regex units(
      "|[mcun]?m|in|inch|k?n|k?g|[mun]?s|sec|seconds|stamp|deg|k?pa|m?bar|psi");
  return std::regex_match(word.substr(stem.size()), units);
}

// The known column that a name seems to mean; empty if it is a known one, or means another.
std::string meantBy(const std::string& name) {
  if (name.empty() || isKnown(name)) return "";
  // pressure_2, Pressure_2_kPa, presure_2_kpa, p2_kpa
  static const std::regex pressure("(p|[presu]{5,10})(0*)([1-9][0-9]{0,2})(k?pas?|m?bar|psi|)");
  std::smatch parts;
  const std::string word = bare(name);
  if (std::regex_match(word, parts, pressure)) return "pressure_" + parts[3].str() + "_kpa";
  for (const char* const known : kNames) {
    if (resembles(word, known)) return known;
  }
  return "";
}

// ---- Text to cells ----

constexpr double kLargest = 1e300;         // stays finite in any unit
constexpr std::size_t kManyFaults = 1000;  // the file is of another kind; more faults help nobody

// The memory of a table, and of everything derived from it, is a small multiple of these.
constexpr std::size_t kMostRows = 200'000;
constexpr std::size_t kMostColumns = 1000;
constexpr std::size_t kMostCells = 4'000'000;
constexpr std::size_t kLongestName = 200;
constexpr std::size_t kLongestCell = 1000;
constexpr int kFarthestHeader = 50;  // lines after the first one

std::string_view trimmed(std::string_view text) {
  constexpr const char* kBlanks = " \t\r";
  const std::size_t first = text.find_first_not_of(kBlanks);
  if (first == std::string_view::npos) return {};
  return text.substr(first, text.find_last_not_of(kBlanks) - first + 1);
}

using Cells = std::vector<std::string_view>;

Cells divided(std::string_view line, char separator) {
  Cells out;
  for (std::size_t end = 0; end != std::string_view::npos;) {
    end = line.find(separator);
    out.push_back(trimmed(line.substr(0, end)));
    line.remove_prefix(end == std::string_view::npos ? line.size() : end + 1);
  }
  return out;
}

// The records of a text, without empty lines and comments: cells divided by commas; those in quotes
// may hold commas, line ends and doubled quotes (RFC 4180).
class Records {
 public:
  explicit Records(std::string_view text) : text_(text) {}

  int line() const { return line_; }  ///< of the record, from 1

  // @return false at the end of the text.
  bool next(Cells& cells) {
    while (!text_.empty()) {
      line_ = next_line_;
      const std::size_t end = text_.find('\n');
      const std::string_view content = trimmed(text_.substr(0, end));
      if (content.find('"') != std::string_view::npos && content.front() != '#') {
        cells = quotedCells();
        return true;
      }
      drop(end == std::string_view::npos ? text_.size() : end + 1);
      if (content.empty() || content.front() == '#') continue;
      cells = divided(content, ',');
      return true;
    }
    return false;
  }

 private:
  void drop(std::size_t count) {
    next_line_ += static_cast<int>(std::count(text_.begin(), text_.begin() + count, '\n'));
    text_.remove_prefix(count);
  }

  Cells quotedCells() {
    unquoted_.clear();
    std::string cell;
    bool inside = false, was_quoted = false;
    const auto endCell = [&] {
      unquoted_.push_back(was_quoted ? cell : std::string(trimmed(cell)));
      cell.clear();
      was_quoted = false;
    };
    std::size_t at = 0;
    for (; at < text_.size(); ++at) {
      const char c = text_[at];
      if (inside && c == '"' && at + 1 < text_.size() && text_[at + 1] == '"') {
        cell += text_[++at];
      } else if (c == '"' && (inside || (!was_quoted && trimmed(cell).empty()))) {
        inside = !inside;
        cell.erase(0, was_quoted ? 0 : cell.size());  // blanks before it
        was_quoted = true;
      } else if (inside) {
        cell += c;
      } else if (c == ',') {
        endCell();
      } else if (c == '\n') {
        break;
      } else if (!was_quoted) {
        cell += c;
      }
    }
    endCell();
    drop(std::min(at + 1, text_.size()));
    return {unquoted_.begin(), unquoted_.end()};
  }

  std::string_view text_;
  int line_ = 0, next_line_ = 1;
  std::deque<std::string> unquoted_;
};

std::size_t knownCount(const Cells& cells) {
  return static_cast<std::size_t>(std::count_if(
      cells.begin(), cells.end(), [](const auto& cell) { return isKnown(std::string(cell)); }));
}

// {column, known one that it seems to mean} of columns that are none, where no other is the meant
// one.
std::vector<std::pair<std::string, std::string>> misspelled(
    const std::vector<std::string>& columns) {
  std::vector<std::pair<std::string, std::string>> out;
  for (const std::string& name : columns) {
    const std::string meant = meantBy(name);
    if (meant.empty() || isAmong(meant, columns)) continue;
    const std::string pascals = meant.substr(0, meant.rfind('_')) + "_pa";
    if (!isPressure(meant) || !isAmong(pascals, columns)) out.emplace_back(name, meant);
  }
  return out;
}

std::string misspelling(const std::string& name, const std::string& meant) {
  return "column '" + basics::quoted(name) + "' is read by nothing; expected " + meant +
         ", spelt like this and in this unit, or a name that is unlike it";
}

std::string atMost(std::size_t found, const char* what, std::size_t most) {
  return basics::messageOf("has ", found, what, "; expected at most ", most);
}

const char* const kOurTable =
    "expected a table with a header such as time_s,pressure_1_kpa,..,x_m,y_m,z_m: seconds, "
    "kilopascals, metres";

// Files that are no table of ours, by how they begin; empty for others.
std::string foreignKind(std::string_view text) {
  const std::string_view first = trimmed(text.substr(0, text.find('\n')));
  const auto begins = [first](std::string_view words) {
    return first.substr(0, words.size()) == words;
  };
  if (begins("version https://git-lfs.github.com/")) {
    return "is a pointer of Git LFS, not the file itself; expected its content: run git lfs pull";
  }
  if (begins("Format Version,")) {
    return std::string("is an export of OptiTrack Motive; ") + kOurTable;
  }
  for (const char* const word :
       {"Trajectories", "Objects", "Segments", "Devices", "Joints", "Model Outputs"}) {
    if (first == word || first == "\"" + std::string(word) + "\"") {
      return std::string("is an export of Vicon Nexus; ") + kOurTable;
    }
  }
  if (text.find("\narm:") != text.npos && text.find("\ncontractions:") != text.npos) {
    return std::string("is a scene, not data; ") + kOurTable;
  }
  if (begins("%time,")) {
    return "is printed by rostopic echo -p; expected a bag of these topics, which calibrate takes "
           "as it is, or " +
           std::string(kOurTable).substr(std::string("expected ").size());
  }
  return "";
}

// Reads the lines of one table.
class TableReader {
 public:
  TableReader(DataSet& data, FaultList& faults, const std::vector<std::string>& skipped)
      : data_(data), faults_(faults), skipped_(skipped) {}

  void read(std::string_view text) {
    if (const std::string kind = foreignKind(text); !kind.empty()) return refuse(0, kind);
    Records records(text);
    Cells cells;
    while (!full_ && records.next(cells)) {
      data_.columns.empty() ? readHeader(cells, records) : readRow(cells, records.line());
      full_ = full_ || faults_.count() > kManyFaults;
    }
    if (full_) return;
    if (data_.columns.empty()) faults_.add(0, "has no header; expected a line of column names");
    if (!data_.columns.empty() && rows_ == 0)
      faults_.add(0, "has no rows; expected at least one below the header");
  }

  /// Takes the values of a table without faults.
  void takeValues() {
    using Rows = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
    const auto columns = static_cast<Eigen::Index>(data_.columns.size());
    const Eigen::Map<const Rows> all(cells_.data(), static_cast<Eigen::Index>(rows_), columns);
    std::vector<std::string> names;
    std::vector<Eigen::Index> kept;
    for (std::size_t i = 0; i < data_.columns.size(); ++i) {
      if (uses_[i] == Use::kNone) continue;
      kept.push_back(static_cast<Eigen::Index>(i));
      names.push_back(std::move(data_.columns[i]));
    }
    data_.columns = std::move(names);
    data_.values = all(Eigen::all, kept);
  }

 private:
  // Cells of a column: they must be numbers, are kept if they are all numbers, or are not looked
  // at.
  enum class Use { kNumbers, kIfNumbers, kNone };

  template <class... Parts>
  void complain(int line, const Parts&... fault) {
    faults_.add(line, basics::messageOf(fault...));
  }
  template <class... Parts>
  void refuse(int line, const Parts&... fault) {
    complain(line, fault...);
    full_ = true;
  }

  // The value of a cell, or its fault.
  using Cell = std::variant<double, std::string>;

  void readHeader(const Cells& cells, Records records) {
    const int line = records.line();
    if (cells.size() > kMostColumns)
      return refuse(line, atMost(cells.size(), " columns", kMostColumns));
    for (std::size_t i = 0; i < cells.size(); ++i) {
      if (cells[i].size() <= kLongestName) continue;
      return refuse(line, "column ", i + 1, " ",
                    atMost(cells[i].size(), " characters in its name", kLongestName));
    }
    if (knownCount(cells) == 0 && !isHeader(cells, records)) return;
    for (const std::string_view cell : cells) {
      const std::string& name = data_.columns.emplace_back(cell);
      const bool unused = name.empty() || isAmong(name, skipped_);
      uses_.push_back(unused ? Use::kNone : isKnown(name) ? Use::kNumbers : Use::kIfNumbers);
    }
    seen_ = data_.find(kSeen);
    checkNames(line);
  }

  // Whether a line without a known name can be the header. Otherwise it is a fault, which names
  // what it is instead.
  bool isHeader(const Cells& cells, Records records) {
    const int line = records.line();
    const struct {
      char character;
      const char* name;
    } separators[] = {{';', "semicolons"}, {'\t', "tabs"}, {'|', "bars"}, {' ', "blanks"}};
    for (const auto& [character, name] : separators) {
      const Cells others = divided(cells.front(), character);
      if (others.size() < 2 || knownCount(others) < 2) continue;
      refuse(line, "is divided by ", name,
             "; expected commas between the cells, and points in numbers");
      return false;
    }
    if (std::all_of(cells.begin(), cells.end(),
                    [](const std::string_view cell) { return parseNumber(cell).has_value(); })) {
      refuse(line, "holds numbers alone; expected a header of column names with their units first");
      return false;
    }
    Cells next;
    for (int i = 0; i < kFarthestHeader && records.next(next); ++i) {
      if (knownCount(next) < 2) continue;
      refuse(line, "is above the header, which is line ", records.line(),
             "; expected the header first: begin the lines above it with #, or leave them out");
      return false;
    }
    return true;
  }

  void checkNames(int line) {
    std::map<std::string, std::size_t> seen;
    for (std::size_t i = 0; i < data_.columns.size(); ++i) {
      if (data_.columns[i].empty()) continue;
      const auto [first, is_new] = seen.emplace(data_.columns[i], i);
      if (is_new) continue;
      complain(line, "column ", i + 1, " has the name of column ", first->second + 1,
               "; expected each name once");
    }
    for (const auto& [name, meant] : misspelled(data_.columns))
      complain(line, misspelling(name, meant));
  }

  void readRow(Cells& cells, int line) {
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
    const std::size_t count = cells.size();
    // A comma behind the last cell, of the header or of a row.
    while (cells.size() > columns && cells.back().empty()) cells.pop_back();
    while (cells.size() < columns && data_.columns[cells.size()].empty()) cells.emplace_back();
    if (cells.size() != columns) {
      return complain(line, "has ", count, " cells; expected ", columns, ", one per column");
    }
    const bool unseen = seen_ >= 0 && parseNumber(cells[seen_]) == 0.0;
    for (std::size_t i = 0; i < columns; ++i) {
      const bool none = uses_[i] == Use::kNone || (unseen && isAmong(data_.columns[i], kMeasured));
      const Cell read = none                         ? Cell(0.0)
                        : data_.columns[i] == kTrial ? trialOf(cells[i])
                                                     : numberOf(cells[i]);
      cells_.push_back(std::holds_alternative<double>(read) ? std::get<double>(read) : 0.0);
      const auto* fault = std::get_if<std::string>(&read);
      if (fault == nullptr) continue;
      if (uses_[i] == Use::kIfNumbers) {
        uses_[i] = Use::kNone;
      } else {
        complain(line, data_.columns[i], " ", *fault);
      }
    }
  }

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
    const std::optional<double> number = parseNumber(cell);
    if (!number) return "is not a finite number; expected one";
    if (std::abs(*number) <= kLargest) return *number;
    return "is too large; expected at most " + formatNumber(kLargest);
  }

  DataSet& data_;
  FaultList& faults_;
  const std::vector<std::string>& skipped_;
  std::vector<Use> uses_;                      // of each column
  std::vector<double> cells_;                  // in row order, 0 where nothing is read
  std::map<std::string, std::size_t> trials_;  // by their names
  std::size_t rows_ = 0;
  int seen_ = -1;      // column
  bool full_ = false;  // the rest is not read
};

// How to convert a pressure column to kilopascals; empty for other columns.
std::string unitsRemedy(const std::string& name) {
  const struct {
    const char *unit, *factor;
  } units[] = {{"_psi", "6.894757"}, {"_mbar", "0.1"}, {"_bar", "100"}, {"_mpa", "1000"}};
  for (const auto& [unit, factor] : units) {
    const std::size_t size = std::char_traits<char>::length(unit);
    if (name.size() > size && name.compare(name.size() - size, size, unit) == 0) {
      return std::string("; multiply it by ") + factor + " and rename it _kpa";
    }
  }
  return "";
}

// Unit of a time that cannot be in seconds, since it would be beyond the year 5000; else null.
const char* unitOfTime(double time) {
  const double size = std::abs(time);
  return size < 1e11   ? nullptr
         : size < 1e14 ? "milliseconds"
         : size < 1e17 ? "microseconds"
                       : "nanoseconds";
}

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

void refuseMisspelled(const DataSet& data) {
  FaultList faults(data.path);
  for (const auto& [name, meant] : misspelled(data.columns)) {
    faults.add(0, misspelling(name, meant));
  }
  faults.throwIfAny();
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

std::vector<std::string> missingPressures(const DataSet& data, int actuators) {
  std::vector<std::string> out;
  for (int i = 1; i <= actuators; ++i) {
    const std::string name = "pressure_" + std::to_string(i);
    if (data.find(name + "_kpa") < 0 && data.find(name + "_pa") < 0) out.push_back(name + "_kpa");
  }
  return out;
}

std::string missingText(const DataSet& data, int actuators) {
  const std::vector<std::string> names = missingPressures(data, actuators);
  const bool known = std::any_of(data.columns.begin(), data.columns.end(), isPressure);
  if (names.empty() || !known) return "";
  return data.path + " has no column " + basics::joined(names) + ", which " +
         (names.size() == 1 ? "counts" : "count") + " as 0 kPa";
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
    faults.add(0, "column '" + basics::quoted(data.columns[i]) +
                      "' belongs to no actuator; expected pressures in " + expected +
                      unitsRemedy(data.columns[i]));
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
    if (const char* unit = unitOfTime(history.time.back()); unit != nullptr) {
      faults.add(data.lines[static_cast<std::size_t>(row)],
                 std::string("time_s is too large for seconds, and looks like ") + unit +
                     "; expected seconds");
      faults.throwIfAny();
    }
    if (first || data.values(row, time) >= data.values(row - 1, time)) continue;
    faults.add(data.lines[static_cast<std::size_t>(row)],
               "time_s goes back; expected times that do not fall, or another trial");
  }
  faults.throwIfAny();
  return history;
}

}  // namespace helix_arm::io
