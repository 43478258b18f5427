#pragma once

#include "helix_arm/RunCalibrationActionGoal.h"
#include "ros_bridge/common/goal_serializers.hpp"

namespace ros::serialization {

template <>
struct Serializer<helix_arm::RunCalibrationActionGoal>
    : helix_arm::ros_bridge::GoalSerializer<helix_arm::RunCalibrationActionGoal> {};

}  // namespace ros::serialization
