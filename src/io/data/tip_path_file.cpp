#include "tip_path_file.hpp"

#include <cmath>
#include <sstream>

#include "basics/text.hpp"
#include "helix_arm/io/fault_list.hpp"
#include "helix_arm/statics/inverse.hpp"
#include "io/document/document.hpp"
#include "io/document/number.hpp"

namespace helix_arm::io {
namespace {

const char* const kTimeColumn = "time_s";
const char* const kAxes[] = {"x_m", "y_m", "z_m"};

void checkTime(const DataSet& data, const std::vector<control::TipWayPoint>& points, int row,
               FaultList& faults) {
  const double time = points[row].time;
  if (!(time >= 0 && time <= control::kLongestPath)) {
    faults.add(data.lines[row], std::string(kTimeColumn) + " is not within 0 to " +
                                    formatNumber(control::kLongestPath) +
                                    "; expected the time since the start of the path");
  }
  if (row == 0 || time - points[row - 1].time >= control::kShortestStep) return;
  faults.add(data.lines[row], std::string(kTimeColumn) + " is not at least " +
                                  formatNumber(control::kShortestStep) + " s after line " +
                                  std::to_string(data.lines[row - 1]) +
                                  "; expected ascending times");
}

}  // namespace

std::vector<control::TipWayPoint> loadTipPath(const DataSet& data) {
  const std::vector<std::string> columns{kTimeColumn, kAxes[0], kAxes[1], kAxes[2]};
  requireColumns(data, columns, basics::joined(columns));
  FaultList faults(data.path);
  std::vector<control::TipWayPoint> points(static_cast<std::size_t>(data.values.rows()));
  if (points.size() < control::kFewestWayPoints || points.size() > control::kMostWayPoints) {
    report(faults, {}, "has ", points.size(), points.size() == 1 ? " row" : " rows", "; expected ",
           control::kFewestWayPoints, " to ", control::kMostWayPoints, " points of a path");
    faults.throwIfAny();
  }
  for (int row = 0; row < data.values.rows(); ++row) {
    control::TipWayPoint& point = points[row];
    point.time = data.values(row, data.find(kTimeColumn));
    checkTime(data, points, row, faults);
    for (int axis = 0; axis < 3; ++axis) {
      point.position[axis] = data.values(row, data.find(kAxes[axis]));
      if (std::abs(point.position[axis]) <= statics::kFarthestTarget) continue;
      faults.add(data.lines[row], std::string(kAxes[axis]) + " is beyond " +
                                      formatNumber(statics::kFarthestTarget) +
                                      "; expected metres from the arm's base");
    }
  }
  faults.throwIfAny();
  return points;
}

std::string tipPathCsv(const std::vector<control::TipWayPoint>& points,
                       const std::string& comment) {
  std::ostringstream text;
  std::istringstream lines(comment);
  for (std::string line; std::getline(lines, line);) text << "# " << line << "\n";
  text << kTimeColumn;
  for (const char* axis : kAxes) text << "," << axis;
  text << "\n";
  for (const control::TipWayPoint& point : points) {
    text << formatNumber(point.time);
    for (const double x : point.position) text << "," << formatNumber(x);
    text << "\n";
  }
  return text.str();
}

}  // namespace helix_arm::io
