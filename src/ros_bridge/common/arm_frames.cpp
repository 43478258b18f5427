#include "ros_bridge/common/arm_frames.hpp"

#include "helix_arm/model/curve.hpp"
#include "ros_bridge/common/conversions.hpp"
#include "ros_bridge/common/model_history.hpp"
#include "ros_bridge/common/names.hpp"

namespace helix_arm::ros_bridge {
namespace {

geometry_msgs::TransformStamped transform(const std::string& parent, const std::string& child,
                                          const lie::SE3& X, const ros::Time& stamp) {
  geometry_msgs::TransformStamped msg;
  msg.header.frame_id = parent;
  msg.header.stamp = stamp;
  msg.child_frame_id = child;
  msg.transform = toTransformMsg(X);
  return msg;
}

}  // namespace

FrameNames::FrameNames(const std::string& world_frame, const std::string& prefix,
                       const std::string& shape, int count)
    : world(world_frame), base(prefix + names::kBaseFrame), tip(prefix + shape + names::kTipFrame) {
  for (int k = 0; k < count; ++k) curve.push_back(prefix + shape + std::to_string(k));
}

geometry_msgs::TransformStamped worldTransform(const std::string& world, const std::string& frame,
                                               const lie::SE3& X) {
  return transform(world, frame, X, ros::Time::now());
}

std::vector<geometry_msgs::TransformStamped> curveTransforms(const FrameNames& names,
                                                             const model::Shape& shape,
                                                             const ros::Time& stamp,
                                                             const lie::SE3& X_BS) {
  const auto curve = model::sampleCurve(shape, static_cast<int>(names.curve.size()));
  std::vector<geometry_msgs::TransformStamped> out;
  out.reserve(curve.size() + 1);
  for (std::size_t k = 0; k < curve.size(); ++k) {
    out.push_back(transform(names.base, names.curve[k], X_BS * curve[k].X, stamp));
  }
  out.push_back(transform(names.base, names.tip, X_BS * model::tipPose(shape), stamp));
  return out;
}

bool endsTf(const ros::Time& stamp) {
  constexpr double kFarAhead = 9;  // [s]
  return secondsBetween(ros::Time::now(), stamp) >= kFarAhead;
}

}  // namespace helix_arm::ros_bridge
