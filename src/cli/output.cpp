#include "output.hpp"

#include <iostream>
#include <limits>
#include <sstream>

#include "basics/text.hpp"
#include "command.hpp"
#include "helix_arm/lie/so3.hpp"

namespace helix_arm::cli {
namespace {

constexpr int kOneLine = -1, kIndent = 2;

std::string textOf(const json& value, int indent) {
  // File names may contain bytes that are not UTF-8.
  return value.dump(indent, ' ', false, json::error_handler_t::replace);
}

// A number or word; entries of a list in one cell, those of an object as "muscle_1=lower".
std::string wordOf(const json& value) {
  if (value.is_null()) return "";
  if (value.is_string()) return value.get<std::string>();
  if (value.is_boolean()) return value.get<bool>() ? "1" : "0";
  if (value.is_number_float()) {
    return std::isfinite(value.get<double>()) ? exact(value.get<double>()) : "";
  }
  if (!value.is_structured()) return value.dump();
  std::vector<std::string> words;
  for (const json& entry : value) words.push_back(wordOf(entry));
  return basics::joined(words, value.is_object() ? "=" : " ");
}

// The same in quotes where it needs them, by RFC 4180.
std::string cellOf(const json& value) {
  const std::string word = wordOf(value);
  if (word.find_first_of(",\"\n") == std::string::npos) return word;
  std::string cell = "\"";
  for (const char c : word) cell += c == '"' ? "\"\"" : std::string(1, c);
  return cell + "\"";
}

using Cells = std::vector<std::pair<std::string, std::string>>;  // names and values

// The name of column i of several.
std::string numbered(std::string name, std::size_t i) {
  const std::size_t mark = name.find_first_of("*@");
  if (mark == std::string::npos) return name;
  return name.replace(mark, 1,
                      name[mark] == '*' ? std::to_string(i + 1) : std::string(1, "xyzw"[i]));
}

void addTwists(const json& twist, const model::Arm& arm, Cells& cells) {
  const char* const entries[] = {"vx_m", "vy_m", "vz_m", "wx_rad", "wy_rad", "wz_rad"};
  for (std::size_t k = 0; k < static_cast<std::size_t>(arm.sectionCount()); ++k) {
    for (std::size_t j = 0; j < 6; ++j) {
      cells.emplace_back("section_" + std::to_string(k + 1) + "_" + entries[j],
                         twist.is_null() ? "" : cellOf(twist[k][j]));
    }
  }
}

void addTriangle(const json& covariance, const model::Arm& arm, Cells& cells) {
  const auto size = static_cast<std::size_t>(6 * arm.sectionCount());
  for (std::size_t i = 0; i < size; ++i) {
    for (std::size_t j = i; j < size; ++j) {
      cells.emplace_back("covariance_" + std::to_string(i + 1) + "_" + std::to_string(j + 1),
                         covariance.is_null() ? "" : cellOf(covariance[i][j]));
    }
  }
}

// The inputs of all actuators, by their own units.
void addInputCells(const json& report, const model::Arm& arm, Cells& cells) {
  for (const char* key : {"pressure_pa", "input", "pressures_pa"}) {
    if (!report.contains(key)) continue;
    for (int i = 0; i < arm.actuatorCount(); ++i) {
      const model::DriveUnit unit = model::unitOf(arm.actuator(i).drive);
      cells.emplace_back(basics::format("%s_%d_%s", unit.quantity, i + 1, unit.si_suffix),
                         cellOf(report[key][static_cast<std::size_t>(i)]));
    }
  }
}

// Columns of the numbers of a list; `count` where there is no list.
void addNumbers(const json& list, const std::string& name, std::size_t count, Cells& cells) {
  for (std::size_t i = 0; i < (list.is_null() ? count : list.size()); ++i) {
    cells.emplace_back(numbered(name, i), list.is_null() ? "" : cellOf(list[i]));
  }
}

void addCells(const json& report, const Column& column, const model::Arm* arm, Cells& cells) {
  const std::string& key = column.key;
  if (key == "inputs") return addInputCells(report, *arm, cells);
  const json& value = key.find('/') == std::string::npos ? report.at(key)
                                                         : report.at(json::json_pointer("/" + key));
  if (key == "twist") return addTwists(value, *arm, cells);
  if (key == "covariance") return addTriangle(value, *arm, cells);
  if (key == "quaternion_xyzw") return addNumbers(value, "q@", 4, cells);
  if (key == "position_m" && column.name.empty()) return addNumbers(value, "@_m", 3, cells);
  if (key == "tip" || key == "base") {
    const bool none = value.is_null();
    addNumbers(none ? json() : value["position_m"], key + "_@_m", 3, cells);
    return addNumbers(none ? json() : value["quaternion_xyzw"], key + "_q@", 4, cells);
  }
  std::string name = column.name.empty() ? key : column.name;
  const bool numbers = value.is_array() && !value.empty() &&
                       (value.front().is_number_float() || value.front().is_null());
  if (!numbers && name.find('@') == std::string::npos) {
    cells.emplace_back(name, cellOf(value));
    return;
  }
  if (column.name.empty()) name.insert(name.rfind('_'), "_*");
  addNumbers(value, name, 3, cells);
}

}  // namespace

json textOrNull(const std::string& text) { return text.empty() ? json() : json(text); }

std::string pressureText(const model::Arm& arm, const Eigen::VectorXd& pressure, int decimals) {
  std::vector<std::string> parts;
  for (int i = 0; i < arm.actuatorCount(); ++i) {
    parts.push_back(arm.actuator(i).name +
                    (std::isfinite(pressure[i])
                         ? basics::format(" %.*f kPa", decimals, pressure[i] / 1e3)
                         : " no reading"));
  }
  return basics::joined(parts);
}

std::string limitsText(const model::Arm& arm, const std::vector<statics::Limit>& limits) {
  std::vector<std::string> parts;
  for (std::size_t i = 0; i < limits.size(); ++i) {
    if (limits[i] == statics::Limit::kNone) continue;
    const bool lower = limits[i] == statics::Limit::kLower;
    parts.push_back(arm.actuator(static_cast<int>(i)).name + (lower ? " lower" : " upper"));
  }
  return basics::joined(parts);
}

void addInputs(const model::Arm& arm, const Eigen::VectorXd& inputs, json& result) {
  result["actuators"] = arm.actuatorNames();
  if (!hasTendon(arm)) {
    result["pressure_pa"] = inputs;
    return;
  }
  json units;
  for (int i = 0; i < arm.actuatorCount(); ++i) {
    units.push_back(model::unitOf(arm.actuator(i).drive).si);
  }
  result["input"] = inputs;
  result["input_unit"] = units;
}

std::string exact(double value) {
  return basics::format("%.*g", std::numeric_limits<double>::max_digits10, value);
}

void CsvTable::add(const json& report) {
  Cells cells;
  for (const Column& column : columns_) addCells(report, column, arm_, cells);
  std::string names, values;
  for (const auto& [name, value] : cells) {
    names += name + ',';
    values += value + ',';
  }
  names.back() = values.back() = '\n';
  out_ << (std::exchange(named_, true) ? "" : names) << values;
}

void printCsv(const json& report, const Csv& csv, std::ostream& out) {
  for (const char* key : csv.comments) {
    const std::string word = wordOf(report.at(key));
    if (!word.empty()) out << "# " << key << " " << word << "\n";
  }
  CsvTable table(out, csv.columns, csv.arm);
  if (csv.rows.empty()) return table.add(report);
  for (const json& row : report.at(csv.rows)) table.add(row);
}

std::string csvText(const std::string& comment, const json& report, const Csv& csv) {
  std::ostringstream out;
  out << comment;
  printCsv(report, csv, out);
  return out.str();
}

RowPrinter::RowPrinter(Format format, const std::string& scene, const CsvTable& table,
                       std::vector<const char*> shown)
    : format_(format), table_(table), shown_(std::move(shown)) {
  if (format_ == Format::kJson) {
    std::cout << "{\"scene\": " << textOf(scene, kOneLine) << ", \"rows\": [";
  }
}

void RowPrinter::add(const std::string& where, const json& report) {
  if (format_ == Format::kCsv) return table_.add(report);
  if (format_ == Format::kJson) {
    std::cout << (any_ ? ",\n" : "\n") << textOf(report, kOneLine);
    any_ = true;
    return;
  }
  json line;
  for (const char* key : shown_) {
    if (report.contains(key)) line[key] = report[key];
  }
  std::cout << where << ": " << lineOf(line) << "\n";
}

void RowPrinter::end() {
  if (format_ == Format::kJson) std::cout << "\n]}\n";
}

void printResult(Format format, const json& report, const json& shown,
                 const std::function<void(std::ostream&)>& csv) {
  if (format == Format::kJson) std::cout << textOf(report, kIndent) << '\n';
  if (format == Format::kCsv) csv(std::cout);
  if (format == Format::kText) printText(shown, std::cout);
}

void printResult(Format format, const json& report, const json& shown, const Csv& csv) {
  printResult(format, report, shown, [&](std::ostream& out) { printCsv(report, csv, out); });
}

}  // namespace helix_arm::cli

namespace nlohmann {

void adl_serializer<helix_arm::lie::SE3>::to_json(json& out, const helix_arm::lie::SE3& pose) {
  out = {{"position_m", pose.translation},
         {"quaternion_xyzw", helix_arm::lie::quaternionXyzw(pose.rotation)}};
}

void adl_serializer<helix_arm::estimation::Suspect>::to_json(
    json& out, const helix_arm::estimation::Suspect& suspect) {
  out = {{"cause", suspect.cause},
         {"where", suspect.where},
         {"explains", suspect.explains},
         {"remedy", suspect.remedy}};
}

}  // namespace nlohmann
