#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <array>

#include "helix_arm/statics/workspace.hpp"

namespace helix_arm::statics {

/// The farthest tips: along and against each axis of the base frame, and away from the base.
class WorkspaceExtremes {
 public:
  /// -x, -y, -z, +x, +y, +z, and the distance from the base.
  static constexpr int kCount = 7;

  /// Inputs (n) [Pa or rad] of an extreme, and its tip, base frame [m].
  struct Extreme {
    Eigen::VectorXd input;
    Eigen::Vector3d tip;
  };

  /// Adds a tip and the inputs that produce it.
  void add(const Eigen::Vector3d& tip, const model::InputRef& input);
  /// Adds all of these points; of equal extremes the first is kept.
  void add(const WorkspacePoints& points);

  bool empty() const { return empty_; }
  /// @param which  index in [0, kCount). Requires !empty().
  const Extreme& of(int which) const { return found_[which]; }
  /// Bounding box of the tips; empty if there are none.
  Eigen::AlignedBox3d bounds() const;
  /// Largest distance of a tip from the base [m]; 0 if there are none.
  double reach() const;

  /// Quantity of a tip that extreme `which` maximises [m].
  static double extent(int which, const Eigen::Vector3d& tip);

 private:
  std::array<Extreme, kCount> found_;
  bool empty_ = true;
};

/// Extremes of an arm within the limits of its inputs. A search starts at the given extremes and at
/// corners of the limits, and climbs to a local maximum with the tier's derivatives (BFGS in the
/// free lengths). The result is the farther of the given and the found extremes.
///
/// Each extreme is a tip that the model reaches at its inputs. It is not proven that no other
/// maximum is higher. The search uses all corners or, if they are many, a selection that includes
/// the lowest and the highest inputs: up to 1024 without load, 128 under load, 8 with the exact
/// tier.
///
/// @param sampled  extremes of sampled points of the same model; may be empty.
WorkspaceExtremes findExtremes(const ArmModel& model, WorkspaceExtremes sampled);

}  // namespace helix_arm::statics
