#pragma once

#include <Eigen/Core>
#include <functional>
#include <optional>
#include <string>

#include "helix_arm/clearance/sweep.hpp"
#include "helix_arm/control/tip_path.hpp"
#include "helix_arm/model/arm.hpp"
#include "helix_arm/statics/inverse.hpp"

namespace helix_arm::follow {

/// Distance of a path from what the arm reaches up to which it is accepted by default [m].
inline constexpr double kPathTolerance = 0.002;
/// Part of the slew rate that a path may use; the rest is for corrections.
inline constexpr double kSlewShare = 0.8;
/// A path is checked at each of its points, and between them at most this far apart: in time [s],
inline constexpr double kCheckStep = 0.01;
/// and along the path, where a turn counts as InverseOptions::rotation_weight [m].
inline constexpr double kCheckSpacing = 0.002;
/// A path with more such places is refused.
inline constexpr int kMostCheckPlaces = 1'000'000;

/// Rules for paths.
struct PathRules {
  double tolerance = kPathTolerance;  ///< largest residual of the inverse, > 0 [m]
  Eigen::VectorXd slew;               ///< (n) of the set points, > 0, may be infinite [Pa/s]
  /// Zones that the arm keeps out of on its way to the path and on it; null: none.
  const clearance::SweepCheck* zones = nullptr;
};

/// Why a path cannot be followed.
enum class PathFault {
  kUnreachable,  ///< it leaves what the arm reaches
  kBlocked,      ///< the arm would come too close to a zone
  kJump,         ///< the pressures have to jump, however slowly it is run
  kTooFast,      ///< the pressures have to change faster than they may
  kTooLong,      ///< it has more than kMostCheckPlaces places
};

/// A path that cannot be followed.
struct PathRefusal {
  PathFault fault;
  double time;               ///< of the worst place, on the path; kTooLong: of its end [s]
  Eigen::Vector3d position;  ///< wanted there, base frame [m]
  /// kUnreachable: residual of the inverse there [m].
  double residual = 0.0;
  /// kJump, kTooFast: the actuator and its rate there [Pa/s].
  int actuator = -1;
  double rate = 0.0;
  /// kTooFast: factor on all times of the path with which it is slow enough, > 1.
  double stretch = 1.0;
  /// All of it in a sentence, with a remedy.
  std::string reason = {};
};

/// Approaches a path and follows it with the inverse. Its speed bounds the distance between checked
/// places, so every place of an accepted path, at whatever time a loop asks for it, is within
/// kCheckSpacing / 2 of a checked one, and within tolerance + kCheckSpacing / 2 of what the arm
/// reaches.
/// @param solver  of this arm; a correction that it has counts.
/// @param start   (n) inputs at which the approach begins [Pa].
/// @param stops   asked at every place, may be empty; true ends the check.
/// @return nothing if the path can be followed, or if the check was stopped.
/// @throws std::invalid_argument on rules that break their contract, otherwise as the
/// InverseSolver.
std::optional<PathRefusal> checkPath(const control::TipPath& path, const model::Arm& arm,
                                     statics::InverseSolver& solver, const Eigen::VectorXd& start,
                                     const PathRules& rules,
                                     const std::function<bool()>& stops = {});

}  // namespace helix_arm::follow
