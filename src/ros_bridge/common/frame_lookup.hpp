#pragma once

#include <string>

#include <ros/node_handle.h>
#include <ros/time.h>
#include <tf2/buffer_core.h>
#include <tf2_msgs/TFMessage.h>

#include "helix_arm/control/target_check.hpp"
#include "helix_arm/lie/se3.hpp"

namespace helix_arm::ros_bridge {

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
  /// Empty and the base's own name need no tf. A frame that tf does not relate to the base is
  /// refused.
  control::Checked<Place> find(const std::string& frame) const;

  const std::string& baseFrame() const { return base_frame_; }

 private:
  void onMoving(const ros::MessageEvent<const tf2_msgs::TFMessage>& event);
  void onStatic(const ros::MessageEvent<const tf2_msgs::TFMessage>& event);
  void take(const ros::MessageEvent<const tf2_msgs::TFMessage>& event, bool is_static);

  const std::string base_frame_;
  tf2::BufferCore buffer_;
  ros::Time last_time_;
  ros::Subscriber moving_subscriber_, static_subscriber_;
};

}  // namespace helix_arm::ros_bridge
