#include "helix_arm/io/tag_poses.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <map>

#include "helix_arm/io/fault_list.hpp"
#include "helix_arm/io/number.hpp"

namespace helix_arm::io {
namespace {

constexpr double kNormTolerance = 1e-2;  // what rounding to two digits does
constexpr double kMostNumber = 1e9;

const char* const kColumns[] = {"capture", "tag", "x_m", "y_m", "z_m", "qx", "qy", "qz", "qw"};

void requireColumns(const DataSet& data) {
  std::string missing;
  for (const char* column : kColumns) {
    if (data.find(column) < 0) missing += (missing.empty() ? "" : ", ") + std::string(column);
  }
  if (missing.empty()) return;
  FaultList faults(data.path);
  faults.add(0, "has no column " + missing +
                    "; expected capture, pressure_1_kpa .., tag, x_m, y_m, z_m, qx, qy, qz, qw");
  faults.throwIfAny();
}

struct Row {
  const DataSet& data;
  int row;
  FaultList& faults;

  int line() const { return data.lines[row]; }
  double operator[](const char* column) const { return data.values(row, data.find(column)); }

  // A whole number >= 0; -1, and a fault, where it is none.
  int number(const char* column) const {
    const double value = (*this)[column];
    if (value >= 0 && value <= kMostNumber && value == std::floor(value)) {
      return static_cast<int>(value);
    }
    faults.add(line(), std::string(column) + " is " + formatNumber(value) +
                           "; expected a whole number >= 0");
    return -1;
  }

  lie::SE3 pose() const {
    const Row& at = *this;
    const Eigen::Quaterniond q(at["qw"], at["qx"], at["qy"], at["qz"]);
    const Eigen::Vector3d p(at["x_m"], at["y_m"], at["z_m"]);
    if (!(std::abs(q.norm() - 1) <= kNormTolerance)) {
      faults.add(line(), "has a quaternion of norm " + formatNumber(q.norm()) + "; expected 1");
      return {Eigen::Matrix3d::Identity(), p};
    }
    return {q.normalized().toRotationMatrix(), p};
  }
};

void addTag(const Row& row, int id, TagPoseCapture& capture) {
  const auto same = std::find_if(capture.tags.begin(), capture.tags.end(),
                                 [id](const TagPose& tag) { return tag.id == id; });
  if (same == capture.tags.end()) {
    capture.tags.push_back({id, row.pose(), row.line()});
    return;
  }
  row.faults.add(row.line(), "measures tag " + std::to_string(id) + " again in capture " +
                                 std::to_string(capture.number) + ", as line " +
                                 std::to_string(same->line) + " does; expected it once");
}

}  // namespace

std::vector<TagPoseCapture> loadTagPoses(const DataSet& data, int actuators) {
  requireColumns(data);
  const Eigen::MatrixXd pressures = pressuresOf(data, actuators);
  FaultList faults(data.path);
  std::vector<TagPoseCapture> captures;
  std::map<int, std::size_t> index;
  for (int i = 0; i < data.values.rows(); ++i) {
    const Row row{data, i, faults};
    const int number = row.number("capture"), id = row.number("tag");
    if (number < 0 || id < 0) continue;
    const Eigen::VectorXd pressure = pressures.row(i);
    const auto [found, is_new] = index.emplace(number, captures.size());
    if (is_new) captures.push_back({number, pressure, {}});
    TagPoseCapture& capture = captures[found->second];
    if (capture.pressure != pressure) {
      faults.add(row.line(), "changes the pressures of capture " + std::to_string(number) +
                                 "; expected them as in line " +
                                 std::to_string(capture.tags.front().line));
    }
    addTag(row, id, capture);
  }
  faults.throwIfAny();
  return captures;
}

}  // namespace helix_arm::io
