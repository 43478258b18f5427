#include "pose_source.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <iterator>
#include <tuple>
#include <utility>

#include "basics/quote.hpp"
#include "basics/text.hpp"
#include "ros_bridge/common/guarded_callbacks.hpp"
#include "ros_bridge/names.hpp"

namespace helix_arm::ros_bridge {
namespace {

constexpr char kPlaceholder[] = "NAME";
constexpr double kNormError = 1e-2;  // of quaternions; float32 and few digits
constexpr double kRestart = 1.0;     // a step back in time that is no late pose [s]

std::string named(std::string text, const std::string& name) {
  for (std::size_t at = 0; (at = text.find(kPlaceholder, at)) != std::string::npos;
       at += name.size()) {
    text.replace(at, sizeof kPlaceholder - 1, name);
  }
  return text;
}

}  // namespace

PoseSource::PoseSource(ros::NodeHandle& node, const PoseOptions& options,
                       const estimation::TagLayout& layout, Take take, Refuse refuse)
    : options_(options), layout_(layout), take_(std::move(take)), refuse_(std::move(refuse)) {
  constexpr int kQueue = 500;
  for (int body = 0; body < static_cast<int>(layout_.tags.size()); ++body) {
    const std::string topic =
        named(options_.topics, layout_.tags[static_cast<std::size_t>(body)].name);
    if (options_.tf) {
      of_frame_[topic] = body;
      continue;
    }
    subscribers_.push_back(listen<geometry_msgs::PoseStamped>(
        node, topic, kQueue,
        [this, body](const auto& event) { onPose(body, *event.getMessage()); }));
  }
  if (options_.tf) {
    subscribers_.push_back(listen(node, names::kTf, kQueue, &PoseSource::onTransforms, this));
  }
}

void PoseSource::onTransforms(const tf2_msgs::TFMessageConstPtr& message) {
  for (const geometry_msgs::TransformStamped& one : message->transforms) {
    const auto body = of_frame_.find(one.child_frame_id);
    if (body == of_frame_.end()) continue;
    geometry_msgs::PoseStamped pose;
    pose.header = one.header;
    pose.pose.position.x = one.transform.translation.x;
    pose.pose.position.y = one.transform.translation.y;
    pose.pose.position.z = one.transform.translation.z;
    pose.pose.orientation = one.transform.rotation;
    onPose(body->second, pose);
  }
}

std::string PoseSource::faultOf(const geometry_msgs::PoseStamped& pose, bool with_rotation) const {
  const auto& [p, q] = std::tie(pose.pose.position, pose.pose.orientation);
  if (!std::isfinite(p.x) || !std::isfinite(p.y) || !std::isfinite(p.z)) {
    return "its position is not finite; send poses of bodies that are seen only";
  }
  const double norm = std::sqrt(q.x * q.x + q.y * q.y + q.z * q.z + q.w * q.w);
  if (with_rotation && !(std::abs(norm - 1) <= kNormError)) {
    return basics::format(
        "its quaternion has the norm %.3g; expected 1: let the system track the body's rotation, "
        "or say noise.rotation_deg: 0 in the scene",
        norm);
  }
  if (pose.header.stamp.isZero()) return "it has no stamp; let the driver stamp it";
  const double age = secondsBetween(pose.header.stamp, ros::Time::now());
  if (std::abs(age) > kLongestAge) {
    return basics::format(
        "it is stamped %.2f s %s ROS time; expected at most %g s: synchronise the clocks of the "
        "two machines, or stamp poses on arrival",
        std::abs(age), age < 0 ? "after" : "before", kLongestAge);
  }
  if (!frame_.empty() && pose.header.frame_id != frame_) {
    return "it is in the frame '" + basics::quoted(pose.header.frame_id) + "', but others in '" +
           basics::quoted(frame_) + "'; send all poses in one frame";
  }
  const double behind = secondsBetween(pose.header.stamp, last_);
  if (!last_.isZero() && behind >= 0 && behind < kRestart) {
    return basics::format("it comes late, %.3f s behind poses that were measured", behind);
  }
  return "";
}

void PoseSource::onPose(int body, const geometry_msgs::PoseStamped& pose) {
  const estimation::TagPlacement& placed = layout_.tags[static_cast<std::size_t>(body)];
  const bool with_rotation = placed.noise->rotation > 0;
  if (const std::string fault = faultOf(pose, with_rotation); !fault.empty()) {
    return refuse_({PictureFault::kBadPose, "pose of body " + placed.name + ": " + fault});
  }
  if (frame_.empty()) frame_ = pose.header.frame_id;
  const auto& [p, q] = std::tie(pose.pose.position, pose.pose.orientation);
  estimation::BodyPose out{body, {Eigen::Matrix3d::Identity(), {p.x, p.y, p.z}}};
  if (with_rotation) {
    out.X_CM.rotation = Eigen::Quaterniond(q.w, q.x, q.y, q.z).normalized().toRotationMatrix();
  }
  add(pose.header.stamp, out);
}

void PoseSource::add(const ros::Time& stamp, const estimation::BodyPose& pose) {
  if (secondsBetween(stamp, last_) >= kRestart) {  // a recording begins anew
    sets_.clear();
    last_ = ros::Time();
  }
  const auto has = [&pose](const BodySet& set) {
    return std::any_of(set.poses.begin(), set.poses.end(),
                       [&pose](const auto& one) { return one.body == pose.body; });
  };
  const ros::SteadyTime now = ros::SteadyTime::now();
  auto place = sets_.end();  // the nearest set that lacks the body
  double nearest = options_.together;
  for (auto one = sets_.begin(); one != sets_.end(); ++one) {
    const double distance = std::abs(secondsBetween(one->first, stamp));
    if (distance > nearest || has(one->second.set)) continue;
    nearest = distance;
    place = one;
  }
  if (place == sets_.end()) place = sets_.emplace(stamp, Waiting{{{}, frame_}, now}).first;
  place->second.set.poses.push_back(pose);
  // Up to the last complete set, and those that have waited long enough.
  const auto isComplete = [this](const auto& one) {
    return one.second.set.poses.size() == layout_.tags.size();
  };
  const auto complete = std::find_if(sets_.rbegin(), sets_.rend(), isComplete);
  auto ready = std::distance(complete, sets_.rend());
  while (!sets_.empty() &&
         (ready > 0 || now - sets_.begin()->second.since > ros::WallDuration(kPatience))) {
    auto next = sets_.extract(sets_.begin());
    --ready;
    last_ = next.key();
    take_({last_, std::move(next.mapped().set)});
  }
}

}  // namespace helix_arm::ros_bridge
