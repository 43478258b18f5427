#pragma once

#include <map>
#include <string>

#include <actionlib_msgs/GoalID.h>
#include <actionlib_msgs/GoalStatusArray.h>
#include <diagnostic_msgs/DiagnosticArray.h>
#include <geometry_msgs/PoseStamped.h>
#include <geometry_msgs/WrenchStamped.h>
#include <rosgraph_msgs/Clock.h>
#include <sensor_msgs/CameraInfo.h>
#include <sensor_msgs/CompressedImage.h>
#include <sensor_msgs/Image.h>
#include <std_srvs/SetBool.h>
#include <std_srvs/Trigger.h>
#include <tf2_msgs/TFMessage.h>
#include <visualization_msgs/InteractiveMarkerFeedback.h>

#include "helix_arm/ArmShape.h"
#include "helix_arm/FollowTipPathAction.h"
#include "helix_arm/ModelError.h"
#include "helix_arm/PressureArray.h"
#include "helix_arm/Reload.h"
#include "helix_arm/RunCalibrationAction.h"
#include "helix_arm/SafetyState.h"
#include "helix_arm/ShapeTarget.h"
#include "helix_arm/TagDetections.h"
#include "helix_arm/TargetStatus.h"
#include "helix_arm/TipTarget.h"
#include "helix_arm/VisionStatus.h"

namespace helix_arm::test {

/// A type of messages, with a sound one.
struct Type {
  std::string name, md5sum, definition;
  std::string bytes;  // of a sound message
};

/// Of a message, without its length.
inline std::string bytesOf(const ros::SerializedMessage& message) {
  return {reinterpret_cast<const char*>(message.message_start),
          message.num_bytes - static_cast<std::size_t>(message.message_start - message.buf.get())};
}

/// A sound message.
template <class Message>
Message sample() {
  return {};
}
template <>
inline ShapeTarget sample() {
  ShapeTarget out;
  out.twist = {0.4, 0, 0, 0, 0.1, 0};
  return out;
}
template <>
inline TipTarget sample() {
  TipTarget out;
  out.pose.position.x = 0.35;
  out.pose.orientation.w = 1;
  return out;
}
template <>
inline geometry_msgs::WrenchStamped sample() {
  geometry_msgs::WrenchStamped out;
  out.wrench.force.y = 0.3;
  return out;
}
template <>
inline RunCalibrationActionGoal sample() {
  RunCalibrationActionGoal out;
  out.goal.fit = {"stiffness"};
  out.goal.plan = {0, 0, 0, 1e5, 0, 0};
  return out;
}
template <>
inline visualization_msgs::InteractiveMarkerFeedback sample() {
  visualization_msgs::InteractiveMarkerFeedback out;
  out.client_id = "/rviz";
  out.marker_name = "tip";
  out.event_type = visualization_msgs::InteractiveMarkerFeedback::POSE_UPDATE;
  out.pose.position.x = 0.35;
  out.pose.orientation.w = 1;
  return out;
}

template <>
inline geometry_msgs::PoseStamped sample() {
  geometry_msgs::PoseStamped out;
  out.pose.position.x = 0.35;
  return out;
}
template <>
inline tf2_msgs::TFMessage sample() {
  geometry_msgs::TransformStamped transform;
  transform.header.frame_id = "arm_base";
  transform.child_frame_id = "table";
  transform.transform.rotation.w = 1;
  tf2_msgs::TFMessage out;
  out.transforms = {transform};
  return out;
}
template <>
inline FollowTipPathActionGoal sample() {
  FollowTipPathActionGoal out;
  out.goal.path.joint_names = {"tip"};
  for (const double y : {0.0035, 0.0185}) {
    trajectory_msgs::MultiDOFJointTrajectoryPoint point;
    point.transforms.resize(1);
    point.transforms[0].translation.x = 0.366;
    point.transforms[0].translation.y = y;
    point.transforms[0].translation.z = 0.0088;
    point.transforms[0].rotation.w = 1;
    point.velocities.resize(1);
    point.time_from_start = ros::Duration(1 + 1000 * (y - 0.0035));
    out.goal.path.points.push_back(point);
  }
  out.goal.hold_s = 0.1;
  return out;
}

template <class... Messages>
std::map<std::string, Type> typesOf() {
  namespace traits = ros::message_traits;
  std::map<std::string, Type> out;
  (out.emplace(traits::datatype<Messages>(),
               Type{traits::datatype<Messages>(), traits::md5sum<Messages>(),
                    traits::definition<Messages>(),
                    bytesOf(ros::serialization::serializeMessage(sample<Messages>()))}),
   ...);
  return out;
}

/// All that the nodes subscribe to; a new one belongs in here.
inline const std::map<std::string, Type>& knownTypes() {
  static const auto kTypes =
      typesOf<ArmShape, ModelError, PressureArray, SafetyState, ShapeTarget, TagDetections,
              TargetStatus, TipTarget, VisionStatus, FollowTipPathActionFeedback,
              FollowTipPathActionGoal, FollowTipPathActionResult, RunCalibrationActionGoal,
              actionlib_msgs::GoalID, actionlib_msgs::GoalStatusArray,
              diagnostic_msgs::DiagnosticArray, geometry_msgs::PoseStamped,
              geometry_msgs::WrenchStamped, rosgraph_msgs::Clock, sensor_msgs::CameraInfo,
              sensor_msgs::CompressedImage, sensor_msgs::Image, tf2_msgs::TFMessage,
              visualization_msgs::InteractiveMarkerFeedback>();
  return kTypes;
}

/// Requests of the services of visual_servo, by the names of these below the node's.
inline const std::map<std::string, Type>& knownRequests() {
  static const auto kTypes = [] {
    const auto types = typesOf<ReloadRequest, std_srvs::SetBoolRequest, std_srvs::TriggerRequest>();
    return std::map<std::string, Type>{{"reload", types.at("helix_arm/ReloadRequest")},
                                       {"close_loop", types.at("std_srvs/SetBoolRequest")},
                                       {"reset", types.at("std_srvs/TriggerRequest")}};
  }();
  return kTypes;
}

}  // namespace helix_arm::test
