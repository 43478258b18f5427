#pragma once

#include <string>
#include <vector>

#include <geometry_msgs/TransformStamped.h>

#include "helix_arm/model/shape.hpp"

namespace helix_arm::ros_bridge {

/// Frame names of one arm and one of its shapes, the model's or the measured one.
struct FrameNames {
  std::string world;
  std::string base;  ///< of the arm, X_WB seen from the world
  /// Along the base curve at evenly spaced s, base and tip included.
  std::vector<std::string> curve;
  std::string tip;

  /// @param prefix  prefix of all names except the world's, so that several arms can share one tf
  /// tree.
  /// @param shape   of the curve's frames: names::kModelFrames or names::kMeasuredFrames.
  /// @param count   number of frames on the curve, >= 2.
  FrameNames(const std::string& world, const std::string& prefix, const std::string& shape,
             int count);
};

/// world -> a frame that does not move: the arm's base, or the camera.
///
/// @param X  the frame seen from the world.
geometry_msgs::TransformStamped worldTransform(const std::string& world, const std::string& frame,
                                               const lie::SE3& X);

/// base -> every frame on the curve, and base -> tip. All have the base as parent, so that errors
/// do not accumulate.
///
/// @param X_BS  start of the curve, seen from the base.
std::vector<geometry_msgs::TransformStamped> curveTransforms(const FrameNames& names,
                                                             const model::Shape& shape,
                                                             const ros::Time& stamp,
                                                             const lie::SE3& X_BS = {});

/// Whether frames with this stamp would break tf for its listeners: they keep 10 s, and ignore
/// everything older than their newest frame by more than that. True for stamps at least 9 s ahead
/// of ROS time, as from a sender whose clock is wrong.
bool endsTf(const ros::Time& stamp);

}  // namespace helix_arm::ros_bridge
