#include "tip_handle.hpp"

#include <cmath>

#include "ros_bridge/common/arm_markers.hpp"
#include "ros_bridge/common/conversions.hpp"
#include "ros_bridge/names.hpp"

namespace helix_arm::ros_bridge {
namespace {

using Control = visualization_msgs::InteractiveMarkerControl;
using Feedback = visualization_msgs::InteractiveMarkerFeedback;

constexpr char kMarker[] = "tip";
constexpr double kFollowStep = 0.002;  // smaller moves are not worth a message [m]
constexpr double kHoldTimeout =
    2.0;  // after which an rviz that ended while dragging releases the handle [s]

// A control whose axis (or normal) is the x axis turned by the quaternion.
Control control(const char* name, std::uint8_t mode, const Eigen::Quaterniond& rotation) {
  Control out;
  out.name = name;
  out.interaction_mode = mode;
  out.orientation = toQuaternionMsg(rotation.toRotationMatrix());
  return out;
}

visualization_msgs::Marker ball(double size) {
  visualization_msgs::Marker out;
  out.type = visualization_msgs::Marker::SPHERE;
  out.pose.orientation.w = 1.0;
  out.scale.x = out.scale.y = out.scale.z = 0.2 * size;
  out.color = color(0.4, 1.0, 0.6, 0.5);
  return out;
}

visualization_msgs::InteractiveMarker handle(const std::string& frame, const io::Scene& scene) {
  const bool planar = scene.planar.has_value();
  const double size = std::clamp(4.0 * scene.looks.back().separator_radius, 0.1, 0.15);  // [m]
  const Eigen::Quaterniond along_x = Eigen::Quaterniond::Identity();
  const Eigen::Quaterniond along_y(Eigen::AngleAxisd(M_PI / 2, Eigen::Vector3d::UnitZ()));
  const Eigen::Quaterniond along_z(Eigen::AngleAxisd(-M_PI / 2, Eigen::Vector3d::UnitY()));
  visualization_msgs::InteractiveMarker out;
  out.header.frame_id = frame;
  out.name = kMarker;
  out.description = "tip target";
  out.scale = static_cast<float>(size);
  out.pose.orientation.w = 1.0;
  Control grip = planar ? control("plane", Control::MOVE_PLANE, along_z)
                        : control("free", Control::MOVE_3D, along_x);
  grip.always_visible = true;
  grip.markers.push_back(ball(size));
  out.controls.push_back(grip);
  out.controls.push_back(control("x", Control::MOVE_AXIS, along_x));
  out.controls.push_back(control("y", Control::MOVE_AXIS, along_y));
  if (!planar) out.controls.push_back(control("z", Control::MOVE_AXIS, along_z));
  return out;
}

}  // namespace

TipHandle::TipHandle(const std::string& base_frame, const io::Scene& scene, OnTarget on_target)
    : on_target_(std::move(on_target)), server_(names::kTipHandle) {
  server_.insert(handle(base_frame, scene), [this](const Feedback::ConstPtr& feedback) {
    guard_.run(feedback->client_id, [&] { onFeedback(feedback); });
  });
  server_.applyChanges();
}

bool TipHandle::held() const {
  return pressed_ && ros::SteadyTime::now() - last_feedback_ < ros::WallDuration(kHoldTimeout);
}

void TipHandle::follow(const lie::SE3& X_BT) {
  if (held() || (X_BT.translation - position_).norm() < kFollowStep) return;
  position_ = X_BT.translation;
  geometry_msgs::Pose pose;
  pose.position = toPointMsg(position_);
  pose.orientation.w = 1.0;
  server_.setPose(kMarker, pose);
  server_.applyChanges();
}

void TipHandle::onFeedback(const visualization_msgs::InteractiveMarkerFeedbackConstPtr& feedback) {
  last_feedback_ = ros::SteadyTime::now();
  if (feedback->event_type == Feedback::MOUSE_DOWN) pressed_ = true;
  if (feedback->event_type == Feedback::MOUSE_UP) pressed_ = false;
  const auto& p = feedback->pose.position;
  position_ = {p.x, p.y, p.z};
  // A handle that is held still sends KEEP_ALIVE; repeating the target then renews the lease.
  const bool wants = feedback->event_type == Feedback::POSE_UPDATE ||
                     (feedback->event_type == Feedback::KEEP_ALIVE && held());
  if (!wants) return;
  TipTarget target;
  target.header = feedback->header;
  target.mode = TipTarget::POSITION;
  target.pose = feedback->pose;
  on_target_(target);
}

}  // namespace helix_arm::ros_bridge
