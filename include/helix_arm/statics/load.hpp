#pragma once

#include <Eigen/Core>
#include <vector>

#include "helix_arm/lie/se3.hpp"

namespace helix_arm::statics {

/// What pulls at one place of the arm. Force and moment keep their directions while the arm moves
/// (dead loads).
struct PointLoad {
  int section = 0;                                   ///< counted from 0 at the base
  double s = 1.0;                                    ///< along that section, in [0, 1]
  double mass = 0.0;                                 ///< >= 0 [kg]
  Eigen::Vector3d force = Eigen::Vector3d::Zero();   ///< base frame [N]
  Eigen::Vector3d moment = Eigen::Vector3d::Zero();  ///< base frame [N m]
  /// Where mass and force act, seen from the base curve's frame at s; it turns with the arm [m].
  Eigen::Vector3d offset = Eigen::Vector3d::Zero();
};

/// What an arm carries. The tip's mass and wrench are a point at the end of the last section.
struct Load {
  Eigen::Vector3d gravity = Eigen::Vector3d::Zero();  ///< base frame [m/s^2]
  std::vector<double> mass;  ///< of each section, spread evenly over s, >= 0 [kg]
  /// Extensional stiffness K_eps of one actuator of each section, that K is normalised by, > 0 [N].
  std::vector<double> K_eps;
  std::vector<PointLoad> points;

  /// True where nothing pulls: no force, no moment, and no mass in gravity.
  bool empty() const;
  /// How many places inside sections, not at their ends, points pull at.
  int innerPlaces() const;
  /// The force of a point, its weight included, base frame [N].
  Eigen::Vector3d forceOf(const PointLoad& point) const {
    return point.force + point.mass * gravity;
  }
  /// @throws std::invalid_argument naming the value and its rule: mass and K_eps of each of so many
  /// sections, all finite, points on the arm.
  void validate(int sections) const;
};

}  // namespace helix_arm::statics
