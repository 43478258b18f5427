#include "pose_reader.hpp"

#include <Eigen/Geometry>
#include <cmath>

#include "helix_arm/basics/pi.hpp"

namespace helix_arm::io {
namespace {

Eigen::Matrix3d turn(double degrees, const Eigen::Vector3d& axis) {
  return Eigen::AngleAxisd(radians(degrees), axis).toRotationMatrix();
}

}  // namespace

double radians(double degrees) { return degrees * (basics::kPi / 180); }

Eigen::Matrix3d rotationOfRpyDeg(const Eigen::Vector3d& rpy_deg) {
  return turn(rpy_deg[2], Eigen::Vector3d::UnitZ()) * turn(rpy_deg[1], Eigen::Vector3d::UnitY()) *
         turn(rpy_deg[0], Eigen::Vector3d::UnitX());
}

Eigen::Vector3d rpyDegOf(const Eigen::Matrix3d& R) {
  // Near a pitch of 90 degrees the yaw is arbitrary; roll is computed from it, so that the rotation
  // is accurate to rounding.
  const double yaw = std::atan2(R(1, 0), R(0, 0));
  const double c = std::cos(yaw), s = std::sin(yaw);
  const double pitch = std::atan2(-R(2, 0), c * R(0, 0) + s * R(1, 0));
  const double roll = std::atan2(s * R(0, 2) - c * R(1, 2), c * R(1, 1) - s * R(0, 1));
  return Eigen::Vector3d(roll, pitch, yaw) * (180 / basics::kPi);
}

std::optional<Eigen::Vector3d> vector3(const std::optional<std::vector<double>>& numbers) {
  if (!numbers) return std::nullopt;
  return Eigen::Vector3d((*numbers)[0], (*numbers)[1], (*numbers)[2]);
}

lie::SE3 readPose(const MapReader& keys, const NumberRule& coordinate) {
  lie::SE3 X;
  if (keys.has("position_m")) {
    const auto p = vector3(keys.numbers("position_m", 3, coordinate));
    if (p) X.translation = *p;
  }
  if (keys.has("rpy_deg")) {
    const auto rpy_deg = vector3(keys.numbers("rpy_deg", 3, kFinite));
    if (rpy_deg) X.rotation = rotationOfRpyDeg(*rpy_deg);
  }
  return X;
}

}  // namespace helix_arm::io
