#pragma once

#include <Eigen/Core>
#include <optional>

#include "helix_arm/control/tip_path.hpp"
#include "helix_arm/lie/se3.hpp"

namespace helix_arm::control {

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
