#include "ros_bridge/common/frame_lookup.hpp"

#include <Eigen/Geometry>
#include <utility>

#include <tf2/exceptions.h>

#include "helix_arm/basics/quote.hpp"
#include "ros_bridge/common/arm_frames.hpp"
#include "ros_bridge/common/clock_gate.hpp"
#include "ros_bridge/common/guarded_callbacks.hpp"
#include "ros_bridge/common/names.hpp"

namespace helix_arm::ros_bridge {
namespace {

lie::SE3 fromMsg(const geometry_msgs::Transform& transform) {
  const auto& q = transform.rotation;
  const auto& p = transform.translation;
  return {Eigen::Quaterniond(q.w, q.x, q.y, q.z).normalized().toRotationMatrix(), {p.x, p.y, p.z}};
}

}  // namespace

FrameLookup::FrameLookup(ros::NodeHandle& node, std::string base_frame)
    : base_frame_(std::move(base_frame)),
      moving_subscriber_(listen(node, names::kTf, 100, &FrameLookup::onMoving, this)),
      static_subscriber_(listen(node, names::kStaticTf, 100, &FrameLookup::onStatic, this)) {}

void FrameLookup::onMoving(const ros::MessageEvent<const tf2_msgs::TFMessage>& event) {
  take(event, false);
}

void FrameLookup::onStatic(const ros::MessageEvent<const tf2_msgs::TFMessage>& event) {
  take(event, true);
}

void FrameLookup::take(const ros::MessageEvent<const tf2_msgs::TFMessage>& event, bool is_static) {
  const ros::Time now = ros::Time::now();
  if (now < last_time_) buffer_.clear();  // a jump back in time; static transforms stay
  last_time_ = now;
  for (const auto& transform : event.getMessage()->transforms) {
    const ros::Time& stamp = transform.header.stamp;
    if (!is_static && (!ClockGate::isSound(stamp) || endsTf(stamp))) continue;
    buffer_.setTransform(transform, event.getPublisherName(), is_static);
  }
}

control::Checked<FrameLookup::Place> FrameLookup::find(const std::string& frame) const {
  if (frame.empty() || frame == base_frame_) return Place{lie::SE3(), true};
  try {
    const auto found = buffer_.lookupTransform(base_frame_, frame, ros::Time());
    return Place{fromMsg(found.transform), found.header.stamp.isZero()};
  } catch (const tf2::TransformException&) {
    return control::Refusal{control::Fault::kWrongFrame,
                            "tf has no transform from the frame '" + basics::quoted(frame) +
                                "' to '" + base_frame_ +
                                "'; publish it, or send data in the frame '" + base_frame_ + "'"};
  }
}

}  // namespace helix_arm::ros_bridge
