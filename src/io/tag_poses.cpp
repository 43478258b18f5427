#include "helix_arm/io/tag_poses.hpp"

#include <Eigen/Geometry>
#include <cmath>

#include "tag_table.hpp"

namespace helix_arm::io {
namespace {

constexpr double kNormTolerance = 1e-2;  // rounding to two digits

lie::SE3 readPoseCells(const TagRow& at) {
  const Eigen::Quaterniond q(at["qw"], at["qx"], at["qy"], at["qz"]);
  const Eigen::Vector3d p(at["x_m"], at["y_m"], at["z_m"]);
  if (!(std::abs(q.norm() - 1) <= kNormTolerance)) {
    at.faults.add(at.line(), "has a quaternion qx, qy, qz, qw that is not of norm 1");
    return {Eigen::Matrix3d::Identity(), p};
  }
  return {q.normalized().toRotationMatrix(), p};
}

}  // namespace

std::vector<TagPoseCapture> loadTagPoses(const DataSet& data, int actuators, const lie::SE3& X_BF) {
  requireTagColumns(data, {"x_m", "y_m", "z_m", "qx", "qy", "qz", "qw"});
  return readTagTable<TagPoseCapture>(data, actuators, [&X_BF](int id, const TagRow& row) {
    return TagPose{id, X_BF * readPoseCells(row), row.line()};
  });
}

}  // namespace helix_arm::io
