#pragma once

#include <functional>
#include <map>
#include <string>
#include <vector>

#include <geometry_msgs/PoseStamped.h>
#include <ros/node_handle.h>
#include <ros/time.h>
#include <tf2_msgs/TFMessage.h>

#include "helix_arm/localization/tag_layout.hpp"
#include "pictures.hpp"
#include "ros_bridge/common/diagnostics.hpp"

namespace helix_arm::ros_bridge {

/// How poses of bodies come.
struct PoseOptions {
  /// Topic of a body, or its frame in tf; NAME stands for its name.
  std::string topics;
  bool tf = false;          ///< as transforms, whose parent is the frame of the poses
  double together = 0.005;  ///< longest time between the stamps of poses that count as one set [s]
};

/// The poses of a motion-capture system's bodies, each from a topic of its own or from tf, gathered
/// to sets of one time. A set is handed over once it has every body, once a later one has, or after
/// kPatience by a steady clock: messages of several topics arrive in any order.
///
/// A pose is dropped, and the reason told, if it is not finite, has a quaternion that is none,
/// comes in another frame than the others, late, or stamped far from ROS time. For the thread of
/// the node's callback queue.
class PoseSource {
 public:
  /// Longest time between a stamp and its arrival, before or after [s]: models of that age are not
  /// compared with poses either.
  static constexpr double kLongestAge = 0.25;

  static constexpr double kPatience = 0.03;  ///< [s]

  using Take = std::function<void(Picture)>;
  using Refuse = std::function<void(const PictureRefusal&)>;

  /// @param layout  of bodies. @param take  gets each set. @param refuse  is told of each drop.
  PoseSource(ros::NodeHandle& node, const PoseOptions& options, const estimation::TagLayout& layout,
             Take take, Refuse refuse);

 private:
  void onPose(int body, const geometry_msgs::PoseStamped& pose);
  void onTransforms(const tf2_msgs::TFMessageConstPtr& message);
  /// Why a pose is not taken; empty if it is.
  std::string faultOf(const geometry_msgs::PoseStamped& pose, bool with_rotation) const;
  void add(const ros::Time& stamp, const estimation::BodyPose& pose);

  const PoseOptions options_;
  const estimation::TagLayout layout_;
  const Take take_;
  const Refuse refuse_;
  std::string frame_;                    ///< of the poses
  std::map<std::string, int> of_frame_;  ///< bodies by their frames in tf
  struct Waiting {
    BodySet set;
    ros::SteadyTime since;
  };
  std::map<ros::Time, Waiting> sets_;  ///< not handed over yet, by their first stamps
  ros::Time last_;                     ///< of the sets that were
  std::vector<ros::Subscriber> subscribers_;
};

}  // namespace helix_arm::ros_bridge
