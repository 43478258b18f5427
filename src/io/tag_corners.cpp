#include "helix_arm/io/tag_corners.hpp"

#include <algorithm>
#include <sstream>

#include "helix_arm/basics/requirement.hpp"
#include "helix_arm/io/number.hpp"
#include "tag_table.hpp"

namespace helix_arm::io {
namespace {

std::vector<std::string> cornerColumns() {
  std::vector<std::string> columns;
  for (int i = 1; i <= estimation::Corners::ColsAtCompileTime; ++i) {
    for (const char* axis : {"x", "y"}) columns.push_back(axis + std::to_string(i) + "_px");
  }
  return columns;
}

}  // namespace

std::vector<TagCornerCapture> loadTagCorners(const DataSet& data, int actuators) {
  const std::vector<std::string> columns = cornerColumns();
  requireTagColumns(data, columns);
  auto captures =
      readTagTable<TagCornerCapture>(data, actuators, [&columns](int id, const TagRow& row) {
        TagCorners tag{id, {}, row.line()};
        for (int i = 0; i < tag.corners.size(); ++i) tag.corners(i) = row[columns[i]];
        return tag;
      });
  const int time = data.find("time_s");
  for (TagCornerCapture& capture : captures) {
    if (time < 0) break;
    const auto line =
        std::lower_bound(data.lines.begin(), data.lines.end(), capture.tags.front().line);
    capture.time = data.values(line - data.lines.begin(), time);
  }
  return captures;
}

std::string tagCornerCsv(const std::vector<TagCornerCapture>& captures, int actuators,
                         const std::string& comment) {
  std::ostringstream text;
  std::istringstream lines(comment);
  for (std::string line; std::getline(lines, line);) text << "# " << line << "\n";
  const bool timed = !captures.empty() &&
                     std::all_of(captures.begin(), captures.end(),
                                 [](const auto& capture) { return capture.time.has_value(); });
  text << (timed ? "capture,time_s" : "capture");
  for (int i = 1; i <= actuators; ++i) text << ",pressure_" << i << "_kpa";
  text << ",tag";
  for (const std::string& column : cornerColumns()) text << "," << column;
  text << "\n";
  for (const TagCornerCapture& capture : captures) {
    basics::require(capture.pressure.size() == actuators, "tagCornerCsv: capture ", capture.number,
                    " has ", capture.pressure.size(), " pressures; expected ", actuators);
    for (const TagCorners& tag : capture.tags) {
      text << capture.number;
      if (timed) text << "," << formatNumber(*capture.time);
      for (const double pressure : capture.pressure) {
        text << "," << formatNumber(kilopascals(pressure));
      }
      text << "," << tag.id;
      for (int i = 0; i < tag.corners.size(); ++i) text << "," << formatNumber(tag.corners(i));
      text << "\n";
    }
  }
  return text.str();
}

}  // namespace helix_arm::io
