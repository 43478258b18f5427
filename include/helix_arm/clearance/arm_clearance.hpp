#pragma once

#include <Eigen/Core>
#include <limits>
#include <memory>
#include <string>
#include <vector>

#include "helix_arm/clearance/keep_out.hpp"
#include "helix_arm/model/shape.hpp"

namespace helix_arm::clearance {

/// Name of the arm's own body among the zones.
inline constexpr char kOwnBody[] = "the arm itself";
/// Error of a distance [m].
inline constexpr double kTolerance = 5e-5;

/// Distance of an arm's body from the nearest zone.
struct Clearance {
  /// [m]; 0 or less: they touch. How deep is known down to where the curve of the arm, or the
  /// tool, enters the zone. Infinite where there is nothing to touch.
  double distance = std::numeric_limits<double>::infinity();
  int zone = -1;  ///< index of the nearest one; their number for the arm's own body; -1: none
  Eigen::Vector3d place = Eigen::Vector3d::Zero();  ///< of the curve or tool, base frame [m]
  /// Distance of the arm from itself [m]; infinite where it does not count.
  double own = std::numeric_limits<double>::infinity();
};

/// Distances of an arm's body from zones and from itself, with FCL.
///
/// The body is all that is nearer to the base curve than the radius of its section, with links as
/// straight lines, and the tool. Along a curve the distance from a convex zone is bounded below by
/// its tangents and by how far the curve is from its chord, so that few places are looked at.
///
/// The own body counts for places between which the curve turns by half a turn or more, and the
/// tool for those from which it turns by a quarter until the tip.
///
/// Immutable; threads may share it.
class ArmClearance {
 public:
  /// @throws std::invalid_argument on sizes that break their rule, and a mesh without triangles.
  explicit ArmClearance(const KeepOut& keep_out);

  const KeepOut& keepOut() const;
  /// Name of Clearance::zone; empty for -1.
  std::string nameOf(int zone) const;

  /// Within kTolerance of the distance.
  /// @param shape  of as many sections as there are radii.
  Clearance of(const model::Shape& shape) const;
  /// Places of the body whose motion from shape to shape is that of all of it, but for a few
  /// percent: along the curve, and the corners of the tool; base frame (3 x places) [m].
  Eigen::Matrix3Xd marks(const model::Shape& shape) const;

 private:
  struct Bodies;
  std::shared_ptr<const Bodies> bodies_;  // which copies share
};

}  // namespace helix_arm::clearance
