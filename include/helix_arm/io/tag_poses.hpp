#pragma once

#include <Eigen/Core>
#include <vector>

#include "helix_arm/io/data_set.hpp"
#include "helix_arm/lie/se3.hpp"

namespace helix_arm::io {

/// A measured pose of one tag.
struct TagPose {
  int id;         ///< in its family
  lie::SE3 X_BT;  ///< seen from the arm's nominal base [m]
  int line;       ///< line in the file
};

/// All tags measured at one time.
struct TagPoseCapture {
  int number;                ///< number in the file
  Eigen::VectorXd pressure;  ///< (actuators) gauge [Pa]
  std::vector<TagPose> tags;
};

/// The captures of a data set with columns capture, pressure_1_kpa .., tag, x_m, y_m, z_m, qx, qy,
/// qz and qw, in the order in which each appears first.
/// @param X_BF  frame F of the poses in the file, seen from the base.
/// @throws DocumentError with all faults: a missing column, a capture or tag that is no whole
/// number >= 0, a quaternion far from norm 1, a tag twice in one capture, pressures that change
/// within a capture.
std::vector<TagPoseCapture> loadTagPoses(const DataSet& data, int actuators, const lie::SE3& X_BF);

}  // namespace helix_arm::io
