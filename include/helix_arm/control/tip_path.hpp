#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <optional>
#include <vector>

#include "helix_arm/lie/se3.hpp"
#include "helix_arm/lie/so3.hpp"

namespace helix_arm::control {

/// A place that the tip passes, and the time when it does.
struct TipWayPoint {
  double time = 0.0;                                   ///< since the start of the path [s]
  Eigen::Vector3d position = Eigen::Vector3d::Zero();  ///< base frame [m]
  std::optional<Eigen::Matrix3d> rotation = {};        ///< R_BT of the tip's frame T
  std::optional<Eigen::Vector3d> velocity = {};        ///< base frame [m/s]
};

/// Wanted place and motion of the tip at one time, base frame.
struct TipReference {
  Eigen::Vector3d position = Eigen::Vector3d::Zero();          ///< [m]
  Eigen::Vector3d velocity = Eigen::Vector3d::Zero();          ///< [m/s]
  std::optional<Eigen::Matrix3d> rotation = {};                ///< R_BT; none: any orientation
  Eigen::Vector3d angular_velocity = Eigen::Vector3d::Zero();  ///< [rad/s]; 0 without rotation
};

/// The part of a path between two neighbouring points.
struct TipSegment {
  double begin, end;  ///< times of the points [s]
  /// Largest coefficient of the velocity's Bernstein polynomials, whose convex hull holds the
  /// velocity: nowhere in the segment is the position faster [m/s].
  double top_speed;
  double turn_rate;  ///< norm of the angular velocity, 0 without rotations [rad/s]
};

/// Limits of a path. With them every value of TipPath::at() is finite.
inline constexpr std::size_t kFewestWayPoints = 2;
inline constexpr std::size_t kMostWayPoints = 100'000;
inline constexpr double kLongestPath = 1e6;    ///< time of the last point [s]
inline constexpr double kShortestStep = 1e-6;  ///< time between neighbouring points [s]
/// Rotation between neighbouring points [rad]; near a half turn its direction would be arbitrary.
inline constexpr double kLargestTurn = 3.0;

/// A path of the tip through way points.
///
/// Positions: with velocities, cubic Hermite polynomials between neighbouring points; without, the
/// cubic spline with continuous acceleration that is at rest at both ends. Rotations: from each
/// point to the next at a constant angular velocity, R exp(u log(R^-1 R_next)), u from 0 to 1.
class TipPath {
 public:
  /// @throws std::invalid_argument naming the first point (counted from 1) that breaks a rule, its
  /// value, the rule and a remedy: kFewestWayPoints to kMostWayPoints points; times within 0 to
  /// kLongestPath, ascending by at least kShortestStep; entries of positions [m] and velocities
  /// [m/s] finite and within statics::kFarthestTarget; velocities for all points or for none;
  /// the same for rotations, which are orthogonal, right-handed, and at most kLargestTurn apart.
  explicit TipPath(const std::vector<TipWayPoint>& points);

  /// The reference at a time [s]: at rest at the first point before firstTime() (and for NaN), at
  /// rest at the last point after lastTime(). Times may come in any order. Does not allocate.
  TipReference at(double time) const noexcept;

  double firstTime() const { return knots_.front().time; }  ///< >= 0 [s]
  double lastTime() const { return knots_.back().time; }    ///< [s]
  bool hasRotations() const { return has_rotations_; }

  std::size_t segmentCount() const { return knots_.size() - 1; }
  TipSegment segment(std::size_t i) const;

 private:
  struct Knot {
    double time;
    Eigen::Vector3d position, velocity;
    lie::SO3 R_BT;
    Eigen::Vector3d turn;  ///< rotation vector to the next knot, tip frame [rad]
  };

  TipReference atRest(const Knot& knot) const noexcept;

  std::vector<Knot> knots_;
  bool has_rotations_ = false;
};

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

/// Default largest speed of an approach [m/s].
inline constexpr double kApproachSpeed = 0.1;

/// A motion of the tip from rest at one place to rest at another, with the least jerk: after the
/// part s of its duration it has covered 10 s^3 - 15 s^4 + 6 s^5 of a straight line and, between
/// poses, of the rotation about a fixed axis. Used to reach the first point of a TipPath.
class TipApproach {
 public:
  /// Between positions, base frame [m]; the orientation is free.
  /// @param most_speed  peak speed, which it reaches half way, > 0 [m/s].
  /// @throws std::invalid_argument on a position that is not finite or beyond
  /// statics::kFarthestTarget, or a speed that breaks its rule or takes longer than kLongestPath.
  TipApproach(const Eigen::Vector3d& from, const Eigen::Vector3d& to,
              double most_speed = kApproachSpeed);

  /// Between poses X_BT. A radian counts as a length of InverseOptions::rotation_weight, so that
  /// the angular speed is limited to most_speed / rotation_weight, too.
  /// @throws std::invalid_argument also on an invalid rotation matrix.
  TipApproach(const lie::SE3& from, const lie::SE3& to, double most_speed = kApproachSpeed);

  /// The reference at a time since the beginning [s]: at rest at `from` before it (and for NaN), at
  /// rest at `to` from duration() on. Does not allocate.
  TipReference at(double time) const noexcept;

  /// 0 where both places are the same [s].
  double duration() const { return duration_; }

 private:
  void setDuration(double length, double most_speed);

  Eigen::Vector3d from_, to_;
  std::optional<lie::SO3> R_BT_;                    ///< of the beginning
  Eigen::Vector3d turn_ = Eigen::Vector3d::Zero();  ///< rotation vector, tip frame [rad]
  double duration_ = 0.0;
};

}  // namespace helix_arm::control
