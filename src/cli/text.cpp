#include <algorithm>
#include <cstdio>
#include <iomanip>
#include <iterator>
#include <map>
#include <utility>

#include "basics/pi.hpp"
#include "basics/quote.hpp"
#include "output.hpp"

namespace helix_arm::cli {

using nlohmann::json;

namespace {

// Unit that the end of a key gives to its numbers.
struct Unit {
  const char* suffix;
  const char* shown;
  double scale;
};
constexpr Unit kUnits[] = {
    {"_n_per_m", "N/m", 1}, {"_nm", "N m", 1},   {"_m", "mm", 1e3},
    {"_pa", "kPa", 1e-3},   {"_kpa", "kPa", 1},  {"_rad", "deg", 180 / basics::kPi},
    {"_deg", "deg", 1},     {"_s", "s", 1},      {"_ns", "us", 1e-3},
    {"_n", "N", 1},         {"_px", "px", 1},    {"_percent", "%", 1},
    {"_m2", "m^2", 1},      {"_nats", "nats", 1}};

// Keys that stand for others, since their own tell no unit, or another word.
constexpr std::pair<const char*, const char*> kNames[] = {
    {"out", "written"},          {"sight", "vision"},
    {"twist", "twist [m, rad]"}, {"quaternion_xyzw", "quaternion"},
    {"warnings", "warning"},     {"notes", "note"},
    {"residual", "residual_m"}};
// Keys in front of, and behind, all others; those in no list stand by the alphabet: numbers and
// words, then tables.
const char* const kFirst[] = {"scene",       "name",    "id",     "file",     "capture",
                              "line",        "s",       "part",   "severity", "tier",
                              "order",       "setting", "state",  "success",  "passed",
                              "vented",      "status",  "kind",   "rank",     "label",
                              "pressure_pa", "summary", "reason", "warnings", "value"};
const char* const kLast[] = {"unit", "note", "notes", "failure", "remedy", "out"};
const char* const kForMachines[] = {"covariance", "covariance_m2", "tip_covariance", "correlation"};

constexpr int kStep = 2;
constexpr std::size_t kWidest = 48;  // cell of a table; longer texts stand below their row

template <std::size_t kCount>
int placeIn(const char* const (&list)[kCount], const std::string& key) {
  const auto found = std::find(std::begin(list), std::end(list), key);
  return found == std::end(list) ? -1 : static_cast<int>(found - std::begin(list));
}

bool isNone(const json& value) {
  return value.is_null() || (value.is_number_float() && !std::isfinite(value.get<double>()));
}

std::string readAs(const std::string& key) {
  for (const auto& [name, read_as] : kNames) {
    if (key == name) return read_as;
  }
  return key;
}

const Unit* unitOf(const std::string& written) {
  const std::string key = readAs(written);
  for (const Unit& unit : kUnits) {
    const std::string suffix = unit.suffix;
    if (key.size() > suffix.size() &&
        key.compare(key.size() - suffix.size(), suffix.size(), suffix) == 0) {
      return &unit;
    }
  }
  return nullptr;
}

std::string nameOf(const std::string& key) {
  const Unit* const unit = unitOf(key);
  std::string name = readAs(key);
  if (unit != nullptr) name.resize(name.size() - std::string(unit->suffix).size());
  std::replace(name.begin(), name.end(), '_', ' ');
  return name;
}

bool isTable(const json& value) {
  return !value.empty() && value.is_structured() &&
         std::all_of(value.begin(), value.end(), [](const json& each) { return each.is_object(); });
}

// A number or word, or a whole array on one line.
std::string textOf(const json& value, const Unit* unit, bool in_list = false) {
  if (isNone(value)) return "-";
  if (value.is_boolean()) return value.get<bool>() ? "yes" : "no";
  if (value.is_string()) return basics::printable(value.get<std::string>());
  if (value.is_array()) {
    const bool rows = !value.empty() && value.front().is_array();
    std::string text;
    for (const json& each : value) {
      text += (text.empty() ? "" : ", ");
      text += rows ? "[" + textOf(each, unit, true) + "]" : textOf(each, unit, true);
    }
    return text;
  }
  if (value.is_number_integer() && (unit == nullptr || unit->scale == 1)) return value.dump();
  const double number = value.get<double>() * (unit ? unit->scale : 1);
  char text[40];
  // Rounding errors of vectors are no digits to read.
  std::snprintf(text, sizeof text, in_list ? unit ? "%.3f" : "%.6f" : "%.6g", number);
  const bool zero = std::string(text).find_first_not_of("-0.") == std::string::npos;
  return zero && text[0] == '-' ? text + 1 : text;
}

// A leaf of a tree with the names on the way to it.
struct Leaf {
  std::string name;
  const Unit* unit;
  const json* value;
  int rank;

  std::string text() const { return textOf(*value, unit); }
  std::string shown() const { return unit ? text() + " " + unit->shown : text(); }
  std::string title() const { return unit ? name + " [" + unit->shown + "]" : name; }
  bool isText() const { return value->is_string(); }
};
using Leaves = std::vector<Leaf>;

void gather(const json& object, const std::string& above, const Unit* unit_above, Leaves& leaves) {
  for (const auto& [key, value] : object.items()) {
    const bool empty = value.is_structured() && value.empty();
    if (empty || placeIn(kForMachines, key) >= 0) continue;
    const Unit* const own = unitOf(key);
    const Unit* const unit = own != nullptr ? own : unit_above;
    const std::string name = above + nameOf(key);
    if (value.is_object() && !isTable(value)) {
      gather(value, name + " ", unit, leaves);
      continue;
    }
    constexpr int kMiddle = 100, kTable = 101, kEnd = 102;
    const int first = above.empty() ? placeIn(kFirst, key) : -1, last = placeIn(kLast, key);
    leaves.push_back({name, isTable(value) ? nullptr : unit, &value,
                      first >= 0       ? first
                      : last >= 0      ? kEnd + last
                      : isTable(value) ? kTable
                                       : kMiddle});
  }
}

Leaves leavesOf(const json& object) {
  Leaves leaves;
  gather(object, "", nullptr, leaves);
  std::stable_sort(leaves.begin(), leaves.end(),
                   [](const Leaf& a, const Leaf& b) { return a.rank < b.rank; });
  return leaves;
}

void printTable(const json& rows, int indent, std::ostream& out);

// A line, or a heading and the table below it.
void printLeaf(const Leaf& leaf, std::size_t width, int indent, std::ostream& out) {
  const std::string space(static_cast<std::size_t>(indent), ' ');
  if (isTable(*leaf.value)) {
    out << space << leaf.name << ":\n";
    return printTable(*leaf.value, indent + kStep, out);
  }
  const auto print = [&](const std::string& text) {
    out << space << std::left << std::setw(static_cast<int>(width)) << leaf.name << "  " << text
        << "\n";
  };
  const bool list = leaf.value->is_array() && leaf.text().size() > kWidest &&
                    (leaf.value->front().is_string() || leaf.value->front().is_array());
  if (!list) return print(leaf.shown());
  for (const json& each : *leaf.value) print(textOf(each, leaf.unit, true));
}

// Whether a table shows a part of a leaf below its row.
bool isBelow(const Leaf& leaf) { return isTable(*leaf.value) || leaf.text().size() > kWidest; }

struct Column {
  std::string title;
  bool below = false, empty = true, left = false;
  std::size_t width = 0;
};

// Number of rows that have the same text below the same title.
std::map<std::pair<std::string, std::string>, int> rowsByText(const std::vector<Leaves>& rows) {
  std::map<std::pair<std::string, std::string>, int> out;
  for (const Leaves& leaves : rows) {
    for (const Leaf& leaf : leaves) {
      if (leaf.isText()) ++out[{leaf.title(), leaf.text()}];
    }
  }
  return out;
}

void printTable(const json& rows, int indent, std::ostream& out) {
  std::vector<Leaves> all;
  std::vector<Column> columns;
  const auto columnOf = [&columns](const Leaf& leaf) -> Column& {
    const std::string title = leaf.title();
    const auto same = [&title](const Column& column) { return column.title == title; };
    const auto found = std::find_if(columns.begin(), columns.end(), same);
    return found != columns.end() ? *found : columns.emplace_back(Column{title});
  };
  for (const auto& [key, row] : rows.items()) {
    Leaves& leaves = all.emplace_back(leavesOf(row));
    if (rows.is_object()) {
      Column& names = columnOf({"", nullptr, nullptr, 0});
      names.width = std::max(names.width, key.size());
    }
    for (const Leaf& leaf : leaves) {
      Column& column = columnOf(leaf);
      column.below = column.below || isBelow(leaf);
      column.empty = column.empty && isNone(*leaf.value);
      column.left = column.left || leaf.isText();
      if (!isBelow(leaf)) column.width = std::max(column.width, leaf.text().size());
    }
  }
  const std::string space(static_cast<std::size_t>(indent), ' ');
  const auto printRow = [&](const std::function<std::string(const Column&)>& cellOf) {
    std::string line;
    for (const Column& column : columns) {
      const bool key = column.title.empty();
      if (!key && (column.below || column.empty)) continue;
      const std::string cell = cellOf(column);
      const std::string pad(std::max(column.width, column.title.size()) - cell.size(), ' ');
      line += column.left || key ? cell + pad + "  " : pad + cell + "  ";
    }
    line.erase(line.find_last_not_of(' ') + 1);
    if (!line.empty()) out << space << line << "\n";
  };
  printRow([](const Column& column) { return column.title; });
  // A long text that several rows have stands below the first of them.
  std::map<std::pair<std::string, std::string>, int> rows_with = rowsByText(all);
  std::size_t i = 0;
  for (const auto& [key, row] : rows.items()) {
    const Leaves& leaves = all[i++];
    printRow([&, name = key](const Column& column) -> std::string {
      if (column.title.empty()) return name;
      for (const Leaf& leaf : leaves) {
        if (leaf.title() == column.title) return leaf.text();
      }
      return "-";
    });
    for (const Leaf& leaf : leaves) {
      if (isNone(*leaf.value) || !columnOf(leaf).below) continue;
      const int count =
          leaf.isText() ? std::exchange(rows_with[{leaf.title(), leaf.text()}], 0) : 1;
      if (count == 1) printLeaf(leaf, 0, indent + 2 * kStep, out);
      if (count <= 1) continue;
      const json told = leaf.shown() + " (" + std::to_string(count) + " rows)";
      printLeaf({leaf.name, nullptr, &told, leaf.rank}, 0, indent + 2 * kStep, out);
    }
  }
}

// The lists that have an entry for each actuator, as one table of them.
json withActuatorTable(json report) {
  const auto found = report.find("actuators");
  if (found == report.end() || !found->is_array()) return report;
  const json names = *found;
  json table = json::array();
  for (const json& name : names) table.push_back({{"name", name}});
  for (auto entry = report.begin(); entry != report.end();) {
    const json& list = entry.value();
    const bool fits = list.is_array() && list.size() == names.size() && !list.empty() &&
                      list.front().is_primitive() &&
                      (unitOf(entry.key()) != nullptr || entry.key().rfind("input", 0) == 0 ||
                       entry.key() == "limits");
    for (std::size_t i = 0; fits && i < names.size(); ++i) table[i][entry.key()] = list[i];
    entry = fits ? report.erase(entry) : std::next(entry);
  }
  report["actuators"] = table;
  return report;
}

}  // namespace

void printText(const json& result, std::ostream& out) {
  const json report = withActuatorTable(result);
  const Leaves leaves = leavesOf(report);
  std::size_t width = 0;
  for (const Leaf& leaf : leaves) {
    if (!isNone(*leaf.value) && !isTable(*leaf.value)) width = std::max(width, leaf.name.size());
  }
  for (const Leaf& leaf : leaves) {
    if (!isNone(*leaf.value)) printLeaf(leaf, width, 0, out);
  }
}

std::string lineOf(const json& result) {
  std::string line;
  for (const Leaf& leaf : leavesOf(result)) {
    if (isNone(*leaf.value)) continue;
    line += (line.empty() ? "" : "; ") + leaf.name + " ";
    if (!isTable(*leaf.value)) line += leaf.shown();
    for (std::size_t i = 0; isTable(*leaf.value) && i < leaf.value->size(); ++i) {
      line += (i > 0 ? ", " : "") + lineOf((*leaf.value)[i]);
    }
  }
  return line;
}

json without(json report, const std::vector<std::string>& keys) {
  if (report.is_object()) {
    for (const std::string& key : keys) report.erase(key);
  }
  if (report.is_structured()) {
    for (json& each : report) each = without(std::move(each), keys);
  }
  return report;
}

}  // namespace helix_arm::cli
