#pragma once

#include <cstdint>
#include <optional>
#include <variant>

#include <ros/time.h>

#include "helix_arm/FollowTipPathGoal.h"
#include "helix_arm/control/tip_path.hpp"
#include "helix_arm/ros_bridge/common/frame_lookup.hpp"
#include "helix_arm/ros_bridge/follow/goal_watch.hpp"

namespace helix_arm::ros_bridge {

/// A goal of follow_tip_path.
struct PathGoal {
  control::TipPath path;       ///< base frame
  ros::Time start;             ///< zero: at once
  GoalRules rules;             ///< without sight_patience
  std::uint8_t on_contact;     ///< of FollowTipPathGoal
  std::optional<double> hold;  ///< of the last point [s]; nothing: the default
};

/// The goal of a message, or why it is refused.
///
/// @param max_age  age of the start that still counts as now, > 0 [s].
std::variant<PathGoal, GoalEnding> fromMsg(const FollowTipPathGoal& goal, const FrameLookup& frames,
                                           double max_age);

}  // namespace helix_arm::ros_bridge
