#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <memory>

#include <fcl/geometry/collision_geometry.h>

#include "helix_arm/clearance/keep_out.hpp"

namespace helix_arm::clearance {

/// A zone for FCL, at its pose seen from the arm's base.
class Obstacle {
 public:
  /// A point and its distance from the zone.
  struct Distance {
    double value;          ///< [m]; 0 inside
    Eigen::Vector3d away;  ///< unit vector from the nearest point of the zone; 0 inside
  };

  /// @throws std::invalid_argument as ArmClearance.
  Obstacle(const Form& form, const lie::SE3& X_BZ, double from);

  /// Whether it is convex, so that the distance is convex along a line.
  bool convex() const { return convex_; }
  double from() const { return from_; }
  Distance of(const Eigen::Vector3d& place) const;
  /// Distance of a box or cylinder at a pose [m].
  double of(const fcl::CollisionGeometryd& body, const Eigen::Isometry3d& X_BT) const;
  /// A lower bound of the distance of a ball's centre [m].
  double atLeast(const Eigen::Vector3d& place) const;

 private:
  const Form form_;
  const double from_;
  Eigen::Isometry3d X_BZ_;
  std::shared_ptr<fcl::CollisionGeometryd> geometry_;  // null for a half-space
  bool convex_ = true;
  double radius_ = 0;  // of a ball about its bounding box
  Eigen::Vector3d centre_ = Eigen::Vector3d::Zero();
};

/// A box or cylinder for FCL. @throws std::invalid_argument on sizes that are not > 0.
std::shared_ptr<fcl::CollisionGeometryd> geometryOf(const std::variant<Box, Cylinder>& form);
Eigen::Isometry3d isometryOf(const lie::SE3& X);

}  // namespace helix_arm::clearance
