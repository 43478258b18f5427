#include "helix_arm/ros_bridge/conversions.hpp"

#include <Eigen/Geometry>

#include "helix_arm/control/quote.hpp"
#include "helix_arm/model/curve.hpp"

namespace helix_arm::ros_bridge {

geometry_msgs::Point toPointMsg(const Eigen::Vector3d& p) {
  geometry_msgs::Point msg;
  msg.x = p.x();
  msg.y = p.y();
  msg.z = p.z();
  return msg;
}

geometry_msgs::Quaternion toQuaternionMsg(const Eigen::Matrix3d& rotation) {
  const Eigen::Quaterniond q = Eigen::Quaterniond(rotation).normalized();
  geometry_msgs::Quaternion msg;
  msg.x = q.x();
  msg.y = q.y();
  msg.z = q.z();
  msg.w = q.w();
  return msg;
}

geometry_msgs::Pose toPoseMsg(const lie::SE3& X) {
  geometry_msgs::Pose msg;
  msg.position = toPointMsg(X.translation);
  msg.orientation = toQuaternionMsg(X.rotation);
  return msg;
}

geometry_msgs::Transform toTransformMsg(const lie::SE3& X) {
  geometry_msgs::Transform msg;
  msg.translation.x = X.translation.x();
  msg.translation.y = X.translation.y();
  msg.translation.z = X.translation.z();
  msg.rotation = toQuaternionMsg(X.rotation);
  return msg;
}

lie::SE3 fromMsg(const geometry_msgs::Pose& pose) {
  const Eigen::Quaterniond q(pose.orientation.w, pose.orientation.x, pose.orientation.y,
                             pose.orientation.z);
  return {q.toRotationMatrix(), {pose.position.x, pose.position.y, pose.position.z}};
}

ArmShape toShapeMsg(const std_msgs::Header& header, const std::string& tier,
                    const model::Twists& twists, const Eigen::MatrixXd& covariance) {
  ArmShape msg;
  msg.header = header;
  msg.tier = tier;
  msg.sections = static_cast<std::uint32_t>(twists.cols());
  msg.twist.assign(twists.data(), twists.data() + twists.size());
  // Symmetric: rows or columns first is all the same.
  msg.twist_covariance.assign(covariance.data(), covariance.data() + covariance.size());
  msg.tip = toPoseMsg(model::tipPose(twists));
  return msg;
}

PressureArray toPressureMsg(const std_msgs::Header& header, const model::Arm& arm,
                            const model::InputRef& pressure) {
  PressureArray msg;
  msg.header = header;
  msg.name.reserve(arm.actuatorCount());
  for (int i = 0; i < arm.actuatorCount(); ++i) msg.name.push_back(arm.actuator(i).name);
  msg.pressure.assign(pressure.data(), pressure.data() + pressure.size());
  return msg;
}

control::Checked<Eigen::VectorXd> fromMsg(const PressureArray& target, const model::Arm& arm,
                                          const model::InputRef& command) {
  return control::checkPressures(arm, command, target.name, target.pressure);
}

control::Checked<model::Twists> fromMsg(const ShapeTarget& target, int sections) {
  return control::checkTwists(sections, target.twist);
}

control::Checked<model::Twists> fromMsg(const ArmShape& shape, int sections,
                                        const std::string& base_frame) {
  using control::Fault, control::Refusal;
  constexpr double kShortest = 1e-3;  // [m]
  const std::string& frame = shape.header.frame_id;
  if (!frame.empty() && frame != base_frame) {
    return Refusal{Fault::kWrongFrame, "it is seen from '" + control::quoted(frame) + "', not '" +
                                           base_frame +
                                           "': give both nodes the same ~frame_prefix"};
  }
  auto checked = control::checkTwists(sections, shape.twist);
  const auto* twists = std::get_if<model::Twists>(&checked);
  if (twists != nullptr && !(twists->topRows<3>().colwise().norm().sum() > kShortest)) {
    return Refusal{Fault::kOutOfRange, "its curve is shorter than 1 mm; send the twists of an arm"};
  }
  return checked;
}

control::Checked<TipGoal> fromMsg(const TipTarget& target, const std::string& base_frame) {
  using control::Fault, control::Refusal;
  const std::string& frame = target.header.frame_id;
  if (!frame.empty() && frame != base_frame) {
    return Refusal{Fault::kWrongFrame, "the tip target is seen from '" + control::quoted(frame) +
                                           "'; transform it to '" + base_frame +
                                           "', or leave frame_id empty"};
  }
  const auto& p = target.pose.position;
  const auto& q = target.pose.orientation;
  if (target.mode == TipTarget::POSITION) {
    const auto position = control::checkPosition({p.x, p.y, p.z});
    if (const auto* refusal = std::get_if<Refusal>(&position)) return *refusal;
    return TipGoal{false, {Eigen::Matrix3d::Identity(), std::get<Eigen::Vector3d>(position)}};
  }
  if (target.mode == TipTarget::POSE) {
    const auto pose = control::checkPose({p.x, p.y, p.z}, {q.w, q.x, q.y, q.z});
    if (const auto* refusal = std::get_if<Refusal>(&pose)) return *refusal;
    return TipGoal{true, std::get<lie::SE3>(pose)};
  }
  return Refusal{Fault::kUnknownMode, "mode " + std::to_string(target.mode) +
                                          " is not known; send 0 (POSITION) or 1 (POSE)"};
}

}  // namespace helix_arm::ros_bridge
