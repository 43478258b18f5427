#pragma once

#include <Eigen/Core>
#include <vector>

#include "helix_arm/control/tip_path.hpp"

namespace helix_arm::control {

/// Closed curves of radius r in a plane with axes a and b, run from a to b.
enum class TipShape {
  kCircle,      ///< begins at (r, 0); constant speed
  kSquare,      ///< corners (+-r, +-r), begins at (r, r); rests at each corner
  kLemniscate,  ///< Bernoulli's, (a^2 + b^2)^2 = r^2 (a^2 - b^2), begins at (r, 0); constant speed
};
inline constexpr TipShape kTipShapes[] = {TipShape::kCircle, TipShape::kSquare,
                                          TipShape::kLemniscate};

/// "circle", "square" or "lemniscate".
const char* nameOf(TipShape shape);

/// Plane of a shape; its axes a and b are those of the base frame in the order of its name.
enum class PathPlane { kXy, kXz, kYz };
inline constexpr PathPlane kPathPlanes[] = {PathPlane::kXy, PathPlane::kXz, PathPlane::kYz};

/// "xy", "xz" or "yz".
const char* nameOf(PathPlane plane);

/// Points of each turn of a shape, a multiple of 4: the corners of a square are points.
inline constexpr int kPointsPerTurn = 200;
inline constexpr int kMostTurns = (static_cast<int>(kMostWayPoints) - 1) / kPointsPerTurn;
/// Share of a side's time in which the speed of a square rises, and in which it falls.
inline constexpr double kSquareRamp = 0.2;

/// A shape that the tip is to draw.
struct ShapedPath {
  TipShape shape = TipShape::kCircle;
  Eigen::Vector3d centre = Eigen::Vector3d::Zero();  ///< base frame [m]
  double radius = 0.02;                              ///< r, > 0 [m]
  double period = 20.0;                              ///< time of one turn [s]
  int turns = 1;                                     ///< 1 to kMostTurns
  PathPlane plane = PathPlane::kYz;
};

/// Points of the shape at even times from 0 to turns * period, without velocities. A TipPath
/// through them stays within 2e-4 r of the curve. It starts and ends at rest, so circle and
/// lemniscate are up to 1e-2 r late or early along the curve in their first and last steps.
/// @throws std::invalid_argument naming the value and its rule, also if the period is so short, or
/// the whole so long or so far away, that TipPath would refuse it.
std::vector<TipWayPoint> wayPointsOf(const ShapedPath& path);

}  // namespace helix_arm::control
