#pragma once

#include <Eigen/Core>
#include <optional>
#include <vector>

#include "helix_arm/lie/se3.hpp"
#include "map_reader.hpp"

namespace helix_arm::io {

double radians(double degrees);

/// Fixed-axis roll, pitch, yaw: Rz(yaw) Ry(pitch) Rx(roll), angles in degrees.
Eigen::Matrix3d rotationOfRpyDeg(const Eigen::Vector3d& rpy_deg);

/// The angles [degrees] that rotationOfRpyDeg() turns into this rotation, pitch in [-90, 90].
Eigen::Vector3d rpyDegOf(const Eigen::Matrix3d& R);

/// Three numbers as a vector.
std::optional<Eigen::Vector3d> vector3(const std::optional<std::vector<double>>& numbers);

/// `position_m` and `rpy_deg` of a map; missing or invalid parts are zero.
lie::SE3 readPose(const MapReader& keys, const NumberRule& coordinate);

}  // namespace helix_arm::io
