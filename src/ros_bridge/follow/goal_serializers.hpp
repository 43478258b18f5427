#pragma once

#include "helix_arm/FollowTipPathActionGoal.h"
#include "helix_arm/ros_bridge/common/goal_serializers.hpp"

namespace ros::serialization {

template <>
struct Serializer<helix_arm::FollowTipPathActionGoal>
    : helix_arm::ros_bridge::GoalSerializer<helix_arm::FollowTipPathActionGoal> {};

}  // namespace ros::serialization
