#include "arm_frames.hpp"

#include <Eigen/Geometry>

#include <tf2/exceptions.h>

#include "basics/quote.hpp"
#include "conversions.hpp"
#include "guarded_callbacks.hpp"
#include "helix_arm/model/curve.hpp"

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

lie::SE3 poseOf(const geometry_msgs::Transform& transform) {
  const auto& q = transform.rotation;
  const auto& p = transform.translation;
  return {Eigen::Quaterniond(q.w, q.x, q.y, q.z).normalized().toRotationMatrix(), {p.x, p.y, p.z}};
}

// Whether frames with this stamp would break tf for its listeners: they keep 10 s, and ignore
// everything older than their newest frame by more than that. True for stamps far ahead of ROS
// time, as from a sender whose clock is wrong.
bool endsTf(const ros::Time& stamp) {
  constexpr double kFarAhead = 9;  // [s]
  return secondsBetween(ros::Time::now(), stamp) >= kFarAhead;
}

}  // namespace

geometry_msgs::TransformStamped worldTransform(const std::string& world, const std::string& frame,
                                               const lie::SE3& X) {
  return transform(world, frame, X, ros::Time::now());
}

void CurveFrames::send(const model::Shape& shape, const ros::Time& stamp, const lie::SE3& X_BS) {
  if (stamp == last_stamp_) return;
  if (endsTf(stamp)) {
    if (far_stamps_.add()) {
      logWarning(
          "%s stamped %.1f s ahead of ROS time (%lu times so far): no tf is published for %s; "
          "synchronise the clocks",
          what_.c_str(), secondsBetween(ros::Time::now(), stamp), far_stamps_.total(), it_.c_str());
    }
    return;
  }
  last_stamp_ = stamp;
  const auto curve = model::sampleCurve(shape, static_cast<int>(names_.curve.size()));
  std::vector<geometry_msgs::TransformStamped> out;
  out.reserve(curve.size() + 1);
  for (std::size_t k = 0; k < curve.size(); ++k) {
    out.push_back(transform(names_.base, names_.curve[k], X_BS * curve[k].X, stamp));
  }
  out.push_back(transform(names_.base, names_.tip, X_BS * model::tipPose(shape), stamp));
  tf_.sendTransform(out);
}

FrameLookup::FrameLookup(ros::NodeHandle& node, std::string base_frame)
    : base_frame_(std::move(base_frame)),
      moving_subscriber_(listen<tf2_msgs::TFMessage>(
          node, names::kTf, 100, [this](const auto& event) { take(event, false); })),
      static_subscriber_(listen<tf2_msgs::TFMessage>(
          node, names::kStaticTf, 100, [this](const auto& event) { take(event, true); })) {}

void FrameLookup::take(const ros::MessageEvent<const tf2_msgs::TFMessage>& event, bool is_static) {
  const ros::Time now = ros::Time::now();
  if (now < last_time_) buffer_.clear();  // a jump back in time; static transforms stay
  last_time_ = now;
  for (const auto& transform : event.getMessage()->transforms) {
    if (!is_static && endsTf(transform.header.stamp)) continue;
    buffer_.setTransform(transform, event.getPublisherName(), is_static);
  }
}

control::Checked<FrameLookup::Place> FrameLookup::find(const std::string& frame) const {
  if (frame.empty() || frame == base_frame_) return Place{lie::SE3(), true};
  try {
    const auto found = buffer_.lookupTransform(base_frame_, frame, ros::Time());
    return Place{poseOf(found.transform), found.header.stamp.isZero()};
  } catch (const tf2::TransformException&) {
    return control::Refusal{control::Fault::kWrongFrame,
                            "tf has no transform from the frame '" + basics::quoted(frame) +
                                "' to '" + base_frame_ +
                                "'; publish it, or send data in the frame '" + base_frame_ + "'"};
  }
}

}  // namespace helix_arm::ros_bridge
