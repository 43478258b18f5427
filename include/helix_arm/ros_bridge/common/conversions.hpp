#pragma once

#include <string>

#include <geometry_msgs/Pose.h>
#include <geometry_msgs/Transform.h>

#include "helix_arm/ArmShape.h"
#include "helix_arm/PressureArray.h"
#include "helix_arm/ShapeTarget.h"
#include "helix_arm/TipTarget.h"
#include "helix_arm/control/target_check.hpp"
#include "helix_arm/lie/se3.hpp"
#include "helix_arm/model/arm.hpp"
#include "helix_arm/model/shape.hpp"
#include "helix_arm/statics/tier.hpp"

/// Between messages and values. Numbers that come in are checked here; nothing beyond trusts a
/// message.
namespace helix_arm::ros_bridge {

geometry_msgs::Point toPointMsg(const Eigen::Vector3d& p);
geometry_msgs::Quaternion toQuaternionMsg(const Eigen::Matrix3d& rotation);
geometry_msgs::Pose toPoseMsg(const lie::SE3& X);
geometry_msgs::Transform toTransformMsg(const lie::SE3& X);

/// The poses of messages that our own nodes sent: neither checked nor normalised.
lie::SE3 fromMsg(const geometry_msgs::Pose& pose);

/// Shape of an arm whose base is `header.frame_id`.
///
/// @param covariance  (6 sections)^2 of the mean twists, [m, rad]; empty where none is known.
ArmShape toShapeMsg(const std_msgs::Header& header, const std::string& tier,
                    const model::Shape& shape, const Eigen::MatrixXd& covariance = {});
/// The same of a model's shape, with the tier that found it and why that one.
ArmShape toShapeMsg(const std_msgs::Header& header, const statics::TierChoice& choice,
                    const model::Shape& shape);

/// Pressures (n) [Pa] of all the arm's actuators, with their names.
PressureArray toPressureMsg(const std_msgs::Header& header, const model::Arm& arm,
                            const model::InputRef& pressure);

/// The command (n) [Pa] that a target asks for; actuators it does not name keep `command`.
control::Checked<Eigen::VectorXd> fromMsg(const PressureArray& target, const model::Arm& arm,
                                          const model::InputRef& command);

/// The twists (6 x sections) of a target; its frame_id is not looked at, since twists are the
/// sections' own.
control::Checked<model::Twists> fromMsg(const ShapeTarget& target, int sections);

/// The shape that a message tells of, whose curve must have some length. Without `pieces` each
/// section is one; with several their sum must be `twist`.
///
/// @param base_frame  the only frame_id, besides an empty one, that is taken.
control::Checked<model::Shape> fromMsg(const ArmShape& shape, int sections,
                                       const std::string& base_frame);

/// What a tip target asks for, base frame.
struct TipGoal {
  bool with_rotation;  ///< false: the orientation of X_BT means nothing
  lie::SE3 X_BT;       ///< wanted tip T seen from the arm's base B [m]
};

/// @param base_frame  the only frame_id, besides an empty one, that is taken.
control::Checked<TipGoal> fromMsg(const TipTarget& target, const std::string& base_frame);

}  // namespace helix_arm::ros_bridge
