#pragma once

#include <string>
#include <vector>

#include <geometry_msgs/TransformStamped.h>

#include "helix_arm/model/arm.hpp"

namespace helix_arm::ros_bridge {

/// Names of one arm's frames.
struct FrameNames {
  std::string world;
  std::string base;  ///< of the arm, X_WB seen from the world
  std::vector<std::string>
      curve;  ///< along the base curve at evenly spaced s, base and tip included
  std::string tip;

  /// @param prefix  set before all names but the world's, so that several arms share one tf tree.
  /// @param count   frames on the curve, >= 2.
  FrameNames(const std::string& world, const std::string& prefix, int count);
};

/// world -> base, which does not move.
geometry_msgs::TransformStamped baseTransform(const FrameNames& names, const lie::SE3& X_WB);

/// base -> every frame on the curve, and base -> tip. All hang from the base: none sums up the
/// errors of others.
std::vector<geometry_msgs::TransformStamped> curveTransforms(const FrameNames& names,
                                                             const model::Twists& twists,
                                                             const ros::Time& stamp);

}  // namespace helix_arm::ros_bridge
