#pragma once

#include <Eigen/Core>
#include <vector>

#include "helix_arm/lie/se3.hpp"
#include "helix_arm/model/arm.hpp"

namespace helix_arm::statics {

/// A load at one point of the arm. Force and moment keep their directions while the arm moves (dead
/// loads).
struct PointLoad {
  int section = 0;                                   ///< section index, counted from 0 at the base
  double s = 1.0;                                    ///< position along that section, in [0, 1]
  double mass = 0.0;                                 ///< >= 0 [kg]
  Eigen::Vector3d force = Eigen::Vector3d::Zero();   ///< base frame [N]
  Eigen::Vector3d moment = Eigen::Vector3d::Zero();  ///< base frame [N m]
  /// Point where mass and force act, seen from the base-curve frame at s, which turns with the arm
  /// [m].
  Eigen::Vector3d offset = Eigen::Vector3d::Zero();
};

using model::StiffnessTable;

/// All loads on an arm. A mass or wrench at the tip is a point load at the end of the last section;
/// its offset includes the arm's last link, if there is one.
struct Load {
  Eigen::Vector3d gravity = Eigen::Vector3d::Zero();  ///< base frame [m/s^2]
  std::vector<double> mass;  ///< mass of each section, distributed evenly over s, >= 0 [kg]
  /// Extensional stiffness K_eps of one actuator of each section, by which K is normalised, > 0
  /// [N].
  std::vector<double> K_eps;
  /// Factor on K_eps as a function of each actuator's own input, per section, relative to its
  /// K_eps, which is then the least one; empty if all are constant.
  std::vector<StiffnessTable> tables;
  std::vector<PointLoad> points;

  /// True if nothing loads the arm: no force, no moment, and no mass under gravity.
  bool empty() const;
  /// Number of distinct places inside sections (not at their ends) where point loads act.
  int innerPlaces() const;
  /// Force of a point load including its weight, base frame [N].
  Eigen::Vector3d forceOf(const PointLoad& point) const {
    return point.force + point.mass * gravity;
  }
  /// The same load, with the points at the start of a section moved to the end of the one before,
  /// to which its link joins them rigidly.
  /// @param links  of the arm; null without any.
  Load atEnds(const model::Links* links) const;
  /// @throws std::invalid_argument naming the value and its rule: one mass and one K_eps for each
  ///     of `sections` sections, all values finite, points on the arm.
  void validate(int sections) const;
};

}  // namespace helix_arm::statics
