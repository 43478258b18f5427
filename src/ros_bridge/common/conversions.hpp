#pragma once

#include <stdexcept>
#include <string>
#include <utility>
#include <variant>
#include <vector>

#include <geometry_msgs/PoseStamped.h>
#include <geometry_msgs/Transform.h>
#include <geometry_msgs/WrenchStamped.h>

#include "helix_arm/ArmShape.h"
#include "helix_arm/PressureArray.h"
#include "helix_arm/TipTarget.h"
#include "helix_arm/control/target_check.hpp"
#include "helix_arm/lie/se3.hpp"
#include "helix_arm/model/arm.hpp"
#include "helix_arm/model/shape.hpp"
#include "helix_arm/statics/inverse.hpp"
#include "helix_arm/statics/tier.hpp"

/// Conversions between messages and values. All incoming numbers are checked here.
namespace helix_arm::ros_bridge {

/// The value. @throws std::invalid_argument with the culprit and the reason where it is refused.
template <class T>
T orThrow(control::Checked<T> checked, const std::string& culprit = {}) {
  const auto* refusal = std::get_if<control::Refusal>(&checked);
  if (refusal != nullptr) throw std::invalid_argument(culprit + refusal->message);
  return std::get<T>(std::move(checked));
}

std_msgs::Header toHeaderMsg(const ros::Time& stamp, const std::string& frame = {});
geometry_msgs::Point toPointMsg(const Eigen::Vector3d& p);
geometry_msgs::Vector3 toVectorMsg(const Eigen::Vector3d& vector);
geometry_msgs::Quaternion toQuaternionMsg(const Eigen::Matrix3d& rotation);
geometry_msgs::Pose toPoseMsg(const lie::SE3& X);
geometry_msgs::Transform toTransformMsg(const lie::SE3& X);

/// Pose of a message from our own nodes: neither checked nor normalised.
lie::SE3 fromMsg(const geometry_msgs::Pose& pose);

/// Shape of an arm whose base is `header.frame_id`.
///
/// @param covariance  (6 sections)^2 of the mean twists, [m, rad]; empty if unknown.
ArmShape toShapeMsg(const std_msgs::Header& header, const std::string& tier,
                    const model::Shape& shape, const Eigen::MatrixXd& covariance = {});
/// The same for a model's shape, with its tier and the reason for that tier.
ArmShape toShapeMsg(const std_msgs::Header& header, const statics::TierChoice& choice,
                    const model::Shape& shape);

/// Outcome of an inverse: `reached`, `unreachable` or `not_converged`.
const char* inverseWord(statics::InverseStatus status);
/// Names of the actuators at a limit.
std::vector<std::string> namesAt(statics::Limit limit, const model::Arm& arm,
                                 const std::vector<statics::Limit>& limits);

/// Pressures (n) [Pa] of all the arm's actuators, with their names.
PressureArray toPressureMsg(const std_msgs::Header& header, const model::Arm& arm,
                            const model::InputRef& pressure);

/// The shape of a message, whose curve must not have length 0. Without `pieces`, each section is
/// one piece; with several, their sum must be `twist`.
///
/// @param arm         the arm of the message, which gives the links.
/// @param base_frame  the only accepted frame_id, besides an empty one.
control::Checked<model::Shape> fromMsg(const ArmShape& shape, const model::Arm& arm,
                                       const std::string& base_frame);

/// The goal of a tip target, base frame.
struct TipGoal {
  bool with_rotation;  ///< false: the orientation of X_BT is ignored
  lie::SE3 X_BT;       ///< wanted tip T seen from the arm's base B [m]
};

/// @param base_frame  the only accepted frame_id, besides an empty one.
control::Checked<TipGoal> fromMsg(const TipTarget& target, const std::string& base_frame);

/// The force at the tip, base frame [N], of a wrench without torque.
///
/// @param base_frame  the only accepted frame_id, besides an empty one.
control::Checked<Eigen::Vector3d> fromMsg(const geometry_msgs::WrenchStamped& wrench,
                                          const std::string& base_frame);

}  // namespace helix_arm::ros_bridge
