#include "loop_targets.hpp"

#include <variant>

#include "helix_arm/regulator/regulator_io.hpp"
#include "ros_bridge/common/guarded_callbacks.hpp"
#include "ros_bridge/names.hpp"

namespace helix_arm::ros_bridge {
namespace {

bool areEqual(const follow::Target& a, const follow::Target& b) {
  if (a.index() != b.index()) return false;
  if (const auto* position = std::get_if<Eigen::Vector3d>(&a)) {
    return *position == std::get<Eigen::Vector3d>(b);
  }
  if (const auto* pose = std::get_if<lie::SE3>(&a)) {
    const auto& other = std::get<lie::SE3>(b);
    return pose->translation == other.translation && pose->rotation == other.rotation;
  }
  return std::get<model::Twists>(a) == std::get<model::Twists>(b);
}

// All zero, as in a message whose orientation was not set.
bool isEmpty(const geometry_msgs::Quaternion& q) {
  return q.x == 0 && q.y == 0 && q.z == 0 && q.w == 0;
}

}  // namespace

LoopTargets::LoopTargets(ros::NodeHandle& node, const io::Scene& scene, const FrameLookup& frames)
    : scene_(scene),
      frames_(frames),
      admission_(node, scene),
      tip_subscriber_(listen(node, names::kTipTarget, 10, &LoopTargets::onTipTarget, this)),
      pose_subscriber_(listen(node, names::kTipPose, 10, &LoopTargets::onTipPose, this)),
      shape_subscriber_(listen(node, names::kShapeTarget, 10, &LoopTargets::onShapeTarget, this)) {}

void LoopTargets::takeFromHandle(const TipTarget& target) {
  aimTip({names::kTipTarget, names::kInteractiveMarker, target.header.stamp}, seenFromBase(target));
}

void LoopTargets::answer(const TargetSolution& solution) {
  for (const TargetSender& sender : unanswered_) {
    if (solution.status == statics::InverseStatus::kNotConverged) {
      admission_.drop(sender, notConverged());
    } else {
      admission_.accept(sender, solution);
    }
  }
  unanswered_.clear();
}

void LoopTargets::refuse(const control::Refusal& refusal) {
  if (refusal.fault == control::Fault::kRested) rested_.hold(commander_, regulator::steadyNow());
  for (const TargetSender& sender : unanswered_) admission_.drop(sender, refusal);
  unanswered_.clear();
  forget();
}

void LoopTargets::onTipTarget(const ros::MessageEvent<const TipTarget>& event) {
  const TipTarget& target = *event.getMessage();
  const TargetSender sender{names::kTipTarget, event.getPublisherName(), target.header.stamp};
  aimTip(sender, admission_.fresh(sender, seenFromBase(target)));
}

void LoopTargets::onTipPose(const ros::MessageEvent<const geometry_msgs::PoseStamped>& event) {
  const geometry_msgs::PoseStamped& pose = *event.getMessage();
  const TargetSender sender{names::kTipPose, event.getPublisherName(), pose.header.stamp};
  TipTarget target;
  target.header = pose.header;
  target.mode = isEmpty(pose.pose.orientation) ? TipTarget::POSITION : TipTarget::POSE;
  target.pose = pose.pose;
  aimTip(sender, admission_.fresh(sender, seenFromBase(target)));
}

void LoopTargets::onShapeTarget(const ros::MessageEvent<const ShapeTarget>& event) {
  const ShapeTarget& target = *event.getMessage();
  const TargetSender sender{names::kShapeTarget, event.getPublisherName(), target.header.stamp};
  const auto checked = admission_.fresh(sender, fromMsg(target, scene_.arm.sectionCount()));
  if (const model::Twists* twists = admission_.admit(sender, checked)) set(sender, *twists);
}

control::Checked<TipGoal> LoopTargets::seenFromBase(const TipTarget& target) const {
  const std::string& frame = target.header.frame_id;
  const auto place = frames_.find(frame);
  if (const auto* refusal = std::get_if<control::Refusal>(&place)) return *refusal;
  const auto checked = fromMsg(target, frame);
  if (const auto* refusal = std::get_if<control::Refusal>(&checked)) return *refusal;
  TipGoal goal = std::get<TipGoal>(checked);
  goal.X_BT = std::get<FrameLookup::Place>(place).X_BF * goal.X_BT;
  const auto inside = control::checkPosition(goal.X_BT.translation);
  if (const auto* refusal = std::get_if<control::Refusal>(&inside)) return *refusal;
  return goal;
}

void LoopTargets::aimTip(const TargetSender& sender, const control::Checked<TipGoal>& checked) {
  const TipGoal* goal = admission_.admit(sender, checked);
  if (goal == nullptr) return;
  if (goal->with_rotation) {
    set(sender, goal->X_BT);
  } else {
    set(sender, goal->X_BT.translation);
  }
}

void LoopTargets::set(const TargetSender& sender, const follow::Target& target) {
  const double pause = scene_.safety.rules.target_timeout;
  if (rested_.refuses(sender.commander, regulator::steadyNow(), pause)) {
    admission_.drop(sender, control::restedRefusal(pause));
    return;
  }
  // A repeated target renews the lease but does not restart the watch for divergence.
  changed_ = changed_ || !target_ || !areEqual(*target_, target);
  target_ = target;
  commander_ = sender.commander;
  last_target_ = ros::SteadyTime::now();
  unanswered_.push_back(sender);
}

}  // namespace helix_arm::ros_bridge
