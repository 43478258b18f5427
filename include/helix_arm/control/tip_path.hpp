#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <optional>
#include <vector>

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

}  // namespace helix_arm::control
