#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <array>

#include "helix_arm/statics/workspace.hpp"

namespace helix_arm::statics {

/// Where the tip goes farthest: against and along each axis of the base frame, and away from the
/// base.
class WorkspaceExtremes {
 public:
  /// -x, -y, -z, +x, +y, +z, and the distance from the base.
  static constexpr int kCount = 7;

  /// Inputs (n) [Pa or rad] that lead there, and the tip, base frame [m].
  struct Extreme {
    Eigen::VectorXd input;
    Eigen::Vector3d tip;
  };

  /// Takes in a tip with the inputs that lead to it.
  void add(const Eigen::Vector3d& tip, const model::InputRef& input);
  /// The same with all of these; equal ones keep those that came first.
  void add(const WorkspacePoints& points);

  bool empty() const { return empty_; }
  /// @param which  in [0, kCount); not empty.
  const Extreme& of(int which) const { return found_[which]; }
  /// Box around the tips; empty where there are none.
  Eigen::AlignedBox3d bounds() const;
  /// Largest distance of a tip from the base [m]; 0 where there are none.
  double reach() const;

  /// What is farthest in one of the directions [m].
  static double extent(int which, const Eigen::Vector3d& tip);

 private:
  std::array<Extreme, kCount> found_;
  bool empty_ = true;
};

/// Extremes of an arm within the limits of its inputs: the farther of those that are given and of
/// what a search finds that starts there and at corners of the limits, and climbs by the tier's
/// derivatives (BFGS in the free lengths) to a local maximum.
///
/// Each is a tip that the model has at its inputs. That no other maximum is higher is not proven.
/// Corners are all there are, or where they are many some of them, with the lowest and the highest
/// inputs among them: up to 1024 without load, 128 under load, 8 by the exact tier.
///
/// @param sampled  of points of the same model; may be empty.
WorkspaceExtremes findExtremes(const ArmModel& model, WorkspaceExtremes sampled);

}  // namespace helix_arm::statics
