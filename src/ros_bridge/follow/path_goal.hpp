#pragma once

#include <atomic>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <variant>
#include <vector>

#include <ros/message_traits.h>
#include <ros/time.h>
#include <std_msgs/Header.h>

#include "helix_arm/FollowTipPathAction.h"
#include "helix_arm/control/tip_path.hpp"
#include "ros_bridge/common/frame_lookup.hpp"
#include "ros_bridge/common/goal_serializers.hpp"
#include "ros_bridge/follow/goal_watch.hpp"

namespace helix_arm::ros_bridge {

/// A goal of follow_tip_path.
struct PathGoal {
  control::TipPath path;       ///< base frame
  ros::Time start;             ///< zero: at once
  GoalRules rules;             ///< without vision_patience
  std::uint8_t on_contact;     ///< of FollowTipPathGoal
  std::optional<double> hold;  ///< of the last point [s]; nothing: the default
};

/// Largest goal [bytes]: kMostWayPoints points, each with a transform, a velocity and an
/// acceleration, have 17.2 MB.
inline constexpr std::uint32_t kMostGoalBytes = 20'000'000;

/// A FollowTipPathGoal as it arrives. The thread that receives it is that of the loop's turns, and
/// a path has up to kMostWayPoints points, each with three arrays. So only the head of the path is
/// read; the rest stays bytes for another thread.
struct UnreadGoal {
  std_msgs::Header path_header;
  std::uint32_t points = 0;  ///< number that the path claims; 0 after more than one joint name
  std::uint32_t size = 0;    ///< of the goal [bytes]
  /// The goal; null if it breaks kMostGoalBytes or control::kMostWayPoints.
  std::shared_ptr<const std::vector<std::uint8_t>> bytes;
};

/// FollowTipPathActionGoal and FollowTipPathAction, for an action server.
struct UnreadActionGoal {
  using _goal_type = UnreadGoal;
  std_msgs::Header header;
  actionlib_msgs::GoalID goal_id;
  UnreadGoal goal;
};
struct UnreadPathAction {
  using _action_goal_type = UnreadActionGoal;
  using _action_result_type = FollowTipPathActionResult;
  using _action_feedback_type = FollowTipPathActionFeedback;
};

/// What a goal becomes: to be followed, or refused.
using DecidedGoal = std::variant<PathGoal, GoalEnding>;

/// Why the arm cannot follow a path, empty if it can. @param tolerance  of its positions [m].
/// @param stop  once it is set, the result does not matter.
using PathCheck = std::function<std::string(const control::TipPath& path, double tolerance,
                                            const std::atomic<bool>& stop)>;

/// Why a goal is refused by its head: its size, or its start. Takes no longer for more points.
/// @param max_age  age of the start that still counts as now, > 0 [s].
std::optional<GoalEnding> refusalOf(const UnreadGoal& goal, double max_age);

/// Place of the frame in which the path of a goal is given, or why the goal is refused.
std::variant<lie::SE3, GoalEnding> frameOf(const UnreadGoal& goal, const FrameLookup& frames);

/// Reads a goal that refusalOf() does not refuse, converts it and checks its path.
/// @param X_BF  place of the path's frame F, seen from the base frame B.
DecidedGoal decide(const UnreadGoal& goal, const lie::SE3& X_BF, const PathCheck& check,
                   const std::atomic<bool>& stop);

}  // namespace helix_arm::ros_bridge

namespace ros {
namespace message_traits {

template <>
struct MD5Sum<helix_arm::ros_bridge::UnreadActionGoal>
    : MD5Sum<helix_arm::FollowTipPathActionGoal> {};
template <>
struct DataType<helix_arm::ros_bridge::UnreadActionGoal>
    : DataType<helix_arm::FollowTipPathActionGoal> {};

}  // namespace message_traits

namespace serialization {

template <>
struct Serializer<helix_arm::ros_bridge::UnreadGoal> {
  static void read(helix_arm::ros_bridge::CheckedStream& stream,
                   helix_arm::ros_bridge::UnreadGoal& goal);
};

template <>
struct Serializer<helix_arm::ros_bridge::UnreadActionGoal>
    : helix_arm::ros_bridge::GoalSerializer<helix_arm::ros_bridge::UnreadActionGoal> {};

}  // namespace serialization
}  // namespace ros
