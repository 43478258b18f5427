#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <optional>
#include <string>
#include <vector>

#include "helix_arm/io/data_set.hpp"
#include "helix_arm/io/fault_list.hpp"
#include "helix_arm/lie/se3.hpp"
#include "helix_arm/localization/tag_layout.hpp"

namespace helix_arm::io {

/// The rotation of a measured quaternion; of one that is far from norm 1 the identity, with a fault
/// of this line.
Eigen::Matrix3d rotationOf(const Eigen::Quaterniond& q, int line, FaultList& faults);

/// A measured pose of one tag.
struct TagPose {
  int id;         ///< in its family
  lie::SE3 X_BT;  ///< seen from the arm's nominal base [m]
  int line;       ///< line in the file
};

/// Corners of one tag in a picture.
struct TagCorners {
  int id;                       ///< in its family
  estimation::Corners corners;  ///< in the picture, with lens distortion [px]
  int line = 0;                 ///< line in the file
};

/// All tags measured at one time.
template <class Tag>
struct TagCapture {
  int number;                ///< number in the file, >= 0
  Eigen::VectorXd pressure;  ///< (actuators) gauge [Pa]
  std::vector<Tag> tags;
  std::optional<double> time = std::nullopt;  ///< on the clock of a series of the arm [s]
};
using TagPoseCapture = TagCapture<TagPose>;
using TagCornerCapture = TagCapture<TagCorners>;

/// The captures of a data set with columns capture, pressure_1_kpa .., tag, x_m, y_m, z_m, qx, qy,
/// qz and qw and, optionally, time_s, in the order in which each appears first.
/// @param X_BF  frame F of the poses in the file, seen from the base.
/// @throws DocumentError with all faults: a missing column, a capture or tag that is no whole
/// number >= 0, a quaternion far from norm 1, a tag twice in one capture, pressures that change
/// within a capture.
std::vector<TagPoseCapture> loadTagPoses(const DataSet& data, int actuators, const lie::SE3& X_BF);

/// The captures of a data set with columns capture, pressure_1_kpa .., tag, x1_px, y1_px .. x4_px
/// and y4_px and, optionally, time_s, in the order in which each appears first. The time of a
/// capture is that of its first row.
/// @throws DocumentError with all faults: a missing column, a capture or tag that is no whole
/// number >= 0, a tag twice in one capture, pressures that change within a capture.
std::vector<TagCornerCapture> loadTagCorners(const DataSet& data, int actuators);

/// The text of such a data set; loading it gives the same numbers, without captures that have no
/// tags.
/// @param actuators  of the arm, >= 1.
/// @param comment    initial comment lines, empty for none.
/// @throws std::invalid_argument on a capture with another number of pressures.
std::string tagCornerCsv(const std::vector<TagCornerCapture>& captures, int actuators,
                         const std::string& comment);
/// The same of a data set of poses, which are written as they are given.
std::string tagPoseCsv(const std::vector<TagPoseCapture>& captures, int actuators,
                       const std::string& comment);

}  // namespace helix_arm::io
