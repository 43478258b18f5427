#include "output.hpp"

#include <Eigen/Geometry>
#include <cmath>
#include <filesystem>
#include <iostream>
#include <limits>
#include <streambuf>

#include "arguments.hpp"
#include "command.hpp"
#include "helix_arm/basics/quote.hpp"
#include "helix_arm/basics/text.hpp"
#include "helix_arm/io/atomic_file.hpp"
#include "helix_arm/lie/so3.hpp"

namespace helix_arm::cli {

using nlohmann::json;

namespace {

namespace fs = std::filesystem;

constexpr int kOneLine = -1, kIndent = 2;

std::string textOf(const json& value, int indent) {
  // File names may contain bytes that are not UTF-8.
  return value.dump(indent, ' ', false, json::error_handler_t::replace);
}

// Whether both paths name the same file, existing or not.
bool samePlace(const std::string& one, const std::string& other) {
  std::error_code error;
  if (fs::equivalent(one, other, error)) return true;
  return fs::weakly_canonical(fs::absolute(one)) == fs::weakly_canonical(fs::absolute(other));
}

// Passes its text on in whole lines, and what there is of one when it is flushed.
class PrintableBuffer : public std::streambuf {
 public:
  explicit PrintableBuffer(std::streambuf& to) : to_(to) {}
  bool pass(std::size_t size) {
    const std::string text = basics::printableLines(std::string_view(waiting_).substr(0, size));
    waiting_.erase(0, size);
    const auto count = static_cast<std::streamsize>(text.size());
    return to_.sputn(text.data(), count) == count;
  }
  bool passAll() { return pass(waiting_.size()); }

 protected:
  int_type overflow(int_type c) override {
    if (traits_type::eq_int_type(c, traits_type::eof())) return traits_type::not_eof(c);
    const char byte = traits_type::to_char_type(c);
    return xsputn(&byte, 1) == 1 ? c : traits_type::eof();
  }
  std::streamsize xsputn(const char* text, std::streamsize size) override {
    waiting_.append(text, static_cast<std::size_t>(size));
    const std::size_t end = waiting_.rfind('\n');
    return end == std::string::npos || pass(end + 1) ? size : 0;
  }
  int sync() override { return passAll() && to_.pubsync() == 0 ? 0 : -1; }

 private:
  std::streambuf& to_;
  std::string waiting_;
};

std::string cellOf(const json& value) {
  if (value.is_null()) return "";
  if (value.is_string()) return value.get<std::string>();
  if (value.is_boolean()) return value.get<bool>() ? "1" : "0";
  if (value.is_number_float()) return exact(value.get<double>());
  if (!value.is_array()) return value.dump();
  std::string cell;
  for (const json& entry : value) cell += (cell.empty() ? "" : " ") + cellOf(entry);
  return cell;
}

}  // namespace

PrintableStream::PrintableStream(std::ostream& stream)
    : stream_(stream),
      filter_(std::make_unique<PrintableBuffer>(*stream.rdbuf())),
      bare_(stream.rdbuf(filter_.get())) {}

PrintableStream::~PrintableStream() {
  static_cast<PrintableBuffer&>(*filter_).passAll();
  stream_.rdbuf(bare_);
}

json toJson(const Eigen::VectorXd& vector) {
  return std::vector<double>(vector.data(), vector.data() + vector.size());
}

json rowsJson(const Eigen::MatrixXd& matrix) {
  json rows = json::array();
  for (int i = 0; i < matrix.rows(); ++i) rows.push_back(toJson(matrix.row(i)));
  return rows;
}

json toJson(const std::optional<double>& number) { return number ? json(*number) : json(); }

json finite(double number) { return std::isfinite(number) ? json(number) : json(); }

json numberOrNull(double value) { return std::isfinite(value) ? json(value) : json(); }

json textOrNull(const std::string& text) { return text.empty() ? json() : json(text); }

json toJson(const lie::SE3& pose) {
  return {{"position_m", toJson(pose.translation)},
          {"quaternion_xyzw", toJson(lie::quaternionXyzw(pose.rotation))}};
}

json suspectsJson(const std::vector<estimation::Suspect>& suspects) {
  return listJson(suspects, [](const estimation::Suspect& one) -> json {
    return {{"cause", one.cause},
            {"where", one.where},
            {"explains", one.explains},
            {"remedy", one.remedy}};
  });
}

json toJson(const model::Twists& twists) { return rowsJson(twists.transpose()); }

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

json readingsJson(const Eigen::VectorXd& pressure) { return listJson(pressure, finite); }

std::string limitsText(const model::Arm& arm, const std::vector<statics::Limit>& limits) {
  std::vector<std::string> parts;
  for (int i = 0; i < arm.actuatorCount(); ++i) {
    const statics::Limit limit = limits[static_cast<std::size_t>(i)];
    if (limit == statics::Limit::kNone) continue;
    parts.push_back(arm.actuator(i).name + (limit == statics::Limit::kLower ? " lower" : " upper"));
  }
  return basics::joined(parts);
}

void addInputs(const model::Arm& arm, const Eigen::VectorXd& inputs, json& result) {
  json units = json::array();
  bool pressures = true;
  for (int i = 0; i < arm.actuatorCount(); ++i) {
    const model::DriveUnit unit = model::unitOf(arm.actuator(i).drive);
    units.push_back(unit.si);
    pressures = pressures && unit.pressure;
  }
  result["actuators"] = actuatorNames(arm);
  if (pressures) {
    result["pressure_pa"] = toJson(inputs);
  } else {
    result["input"] = toJson(inputs);
    result["input_unit"] = units;
  }
}

CsvTable::CsvTable(const json& reports, const std::vector<const char*>& keys) {
  for (const json& report : reports) rows_.push_back(cellsOf(report, keys));
}

void CsvTable::print(std::ostream& out) const {
  if (rows_.empty()) return;
  printNames(rows_.front(), out);
  for (const Row& row : rows_) printValues(row, out);
}

void CsvTable::printNames(const Row& row, std::ostream& out) {
  for (std::size_t i = 0; i < row.size(); ++i) out << (i == 0 ? "" : ",") << row[i].first;
  out << '\n';
}

void CsvTable::printValues(const Row& row, std::ostream& out) {
  for (std::size_t i = 0; i < row.size(); ++i) out << (i == 0 ? "" : ",") << row[i].second;
  out << '\n';
}

CsvTable::Row cellsOf(const json& report, const std::vector<const char*>& keys) {
  CsvTable::Row row;
  for (const std::string key : keys) {
    const json& value = report.at(key);
    const bool numbers = value.is_array() && !value.empty() &&
                         (value.front().is_number_float() || value.front().is_null());
    if (!numbers) {
      row.emplace_back(key, cellOf(value));
      continue;
    }
    const std::size_t unit = key.rfind('_');
    for (std::size_t i = 0; i < value.size(); ++i) {
      row.emplace_back(key.substr(0, unit) + "_" + std::to_string(i + 1) + key.substr(unit),
                       cellOf(value[i]));
    }
  }
  return row;
}

void printComments(const json& report, std::vector<const char*> keys) {
  if (!report["reason"].is_null()) keys.push_back("reason");
  for (const auto& [key, cell] : cellsOf(report, keys)) {
    std::cout << "# " << key << " " << cell << "\n";
  }
}

std::string quotedCell(const std::string& text) {
  std::string cell = "\"";
  for (const char c : text) cell += c == '"' ? "\"\"" : std::string(1, c);
  return cell + "\"";
}

std::string exact(double value) {
  return basics::format("%.*g", std::numeric_limits<double>::max_digits10, value);
}

std::string exact(const std::optional<double>& value) {
  return value ? exact(*value) : std::string();
}

void appendInputs(const model::Arm& arm, const Eigen::VectorXd& inputs, CsvTable::Row& row) {
  for (int i = 0; i < arm.actuatorCount(); ++i) {
    const model::DriveUnit unit = model::unitOf(arm.actuator(i).drive);
    row.emplace_back(
        std::string(unit.quantity) + "_" + std::to_string(i + 1) + "_" + unit.si_suffix,
        exact(inputs[i]));
  }
}

void appendTwists(const json& twist, int sections, CsvTable::Row& row) {
  const std::string entries[] = {"vx_m", "vy_m", "vz_m", "wx_rad", "wy_rad", "wz_rad"};
  for (std::size_t k = 0; k < static_cast<std::size_t>(sections); ++k) {
    for (std::size_t j = 0; j < 6; ++j) {
      row.emplace_back("section_" + std::to_string(k + 1) + "_" + entries[j],
                       twist.is_null() ? "" : cellOf(twist[k][j]));
    }
  }
}

void appendPose(const std::string& prefix, const json& pose, CsvTable::Row& row) {
  const char* const entries[] = {"x_m", "y_m", "z_m", "qx", "qy", "qz", "qw"};
  for (std::size_t i = 0; i < 7; ++i) {
    const char* const key = i < 3 ? "position_m" : "quaternion_xyzw";
    row.emplace_back(prefix + entries[i],
                     pose.is_null() ? "" : cellOf(pose[key][i < 3 ? i : i - 3]));
  }
}

RowPrinter::RowPrinter(Format format, const std::string& scene) : format_(format) {
  if (format_ == Format::kJson) {
    std::cout << "{\"scene\": " << textOf(scene, kOneLine) << ", \"rows\": [";
  }
}

void RowPrinter::add(const std::string& where, const std::function<json()>& report,
                     const std::function<CsvTable::Row()>& cells,
                     const std::vector<const char*>& shown) {
  if (format_ == Format::kText) {
    const json all = report();
    json line;
    for (const char* key : shown) {
      if (all.contains(key)) line[key] = all[key];
    }
    std::cout << where << ": " << lineOf(line) << "\n";
  }
  if (format_ == Format::kJson) {
    std::cout << (any_ ? ",\n" : "\n") << textOf(report(), kOneLine);
  }
  if (format_ == Format::kCsv) {
    const CsvTable::Row row = cells();
    if (!any_) CsvTable::printNames(row, std::cout);
    CsvTable::printValues(row, std::cout);
  }
  any_ = true;
}

void RowPrinter::end() {
  if (format_ == Format::kJson) std::cout << "\n]}\n";
}

void printResult(Format format, const json& report, const json& shown,
                 const std::function<CsvTable()>& table) {
  if (format == Format::kJson) std::cout << textOf(report, kIndent) << '\n';
  if (format == Format::kCsv) table().print(std::cout);
  if (format == Format::kText) printText(shown, std::cout);
}

void checkPicture(const std::string& png, const std::string& out) {
  if (png.empty()) return;
  refuseIf(!out.empty() && samePlace(out, png), "--png ", png,
           " is the file of --out, too; give another path");
  const io::AtomicFile trial(png);  // throws if none can be written there; leaves no file
}

}  // namespace helix_arm::cli
