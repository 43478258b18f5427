#pragma once

#include <string>
#include <utility>
#include <vector>

#include <geometry_msgs/TransformStamped.h>
#include <ros/node_handle.h>
#include <ros/time.h>
#include <tf2/buffer_core.h>
#include <tf2_msgs/TFMessage.h>
#include <tf2_ros/transform_broadcaster.h>

#include "diagnostics.hpp"
#include "helix_arm/control/target_check.hpp"
#include "helix_arm/lie/se3.hpp"
#include "helix_arm/model/shape.hpp"
#include "ros_bridge/names.hpp"

namespace helix_arm::ros_bridge {

/// Frame names of one arm and one of its shapes, the model's or the measured one.
struct FrameNames {
  std::string world;
  std::string base;  ///< of the arm, X_WB seen from the world
  /// Along the base curve at evenly spaced s, base and tip included.
  std::vector<std::string> curve;
  std::string tip;

  /// @param prefix  of all names except the world's, so that several arms can share one tf tree.
  /// @param shape   of the curve's frames: names::kModelFrames or names::kMeasuredFrames.
  /// @param count   number of frames on the curve, >= 2.
  FrameNames(const std::string& world_frame, const std::string& prefix, const std::string& shape,
             int count)
      : world(world_frame),
        base(prefix + names::kBaseFrame),
        tip(prefix + shape + names::kTipFrame) {
    for (int k = 0; k < count; ++k) curve.push_back(prefix + shape + std::to_string(k));
  }
};

/// world -> a frame that does not move: the arm's base, or the camera.
///
/// @param X  the frame seen from the world.
geometry_msgs::TransformStamped worldTransform(const std::string& world, const std::string& frame,
                                               const lie::SE3& X);

/// Sends to tf base -> every frame on the curve, and base -> tip, each stamp once, since tf would
/// warn of repeated ones. All have the base as parent, so that errors do not accumulate. Frames
/// that would break tf, since their stamps are far ahead, are not sent, with a warning.
class CurveFrames {
 public:
  /// @param what, it  What is stamped and how it is referred to, such as "pictures are" and "them".
  CurveFrames(FrameNames names, std::string what, std::string it)
      : names_(std::move(names)), what_(std::move(what)), it_(std::move(it)) {}

  /// @param X_BS  start of the curve, seen from the base.
  void send(const model::Shape& shape, const ros::Time& stamp, const lie::SE3& X_BS = {});

 private:
  const FrameNames names_;
  const std::string what_, it_;
  ros::Time last_stamp_;
  FaultCount far_stamps_;
  tf2_ros::TransformBroadcaster tf_;
};

/// Where the frames of tf are, seen from one frame. For the thread of the node's callback queue.
///
/// tf2_ros::TransformListener has a thread that a broken message would end; here such a message is
/// dropped. So are transforms stamped so far ahead that they would hide all later ones.
class FrameLookup {
 public:
  /// @param base_frame  B, from which the frames are seen.
  FrameLookup(ros::NodeHandle& node, std::string base_frame);

  /// Place of a frame F.
  struct Place {
    lie::SE3 X_BF;  ///< newest one [m]
    bool fixed;     ///< only static transforms lie between the two
  };
  /// Empty and the base's own name need no tf. A frame that tf does not relate to it is refused.
  control::Checked<Place> find(const std::string& frame) const;

  const std::string& baseFrame() const { return base_frame_; }

 private:
  void take(const ros::MessageEvent<const tf2_msgs::TFMessage>& event, bool is_static);

  const std::string base_frame_;
  tf2::BufferCore buffer_;
  ros::Time last_time_;
  ros::Subscriber moving_subscriber_, static_subscriber_;
};

}  // namespace helix_arm::ros_bridge
