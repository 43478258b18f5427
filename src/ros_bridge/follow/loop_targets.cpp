#include "loop_targets.hpp"

#include <utility>
#include <variant>

namespace helix_arm::ros_bridge {

const std::optional<follow::Target>& LoopTargets::target() {
  if (target_ && isSilent()) forget();
  return target_;
}

void LoopTargets::forget() {
  target_.reset();
  commander_.clear();
  changed_ = false;
}

const std::string& LoopTargets::commander() const {
  return commander_.empty() && isRefused() ? refused_commander_ : commander_;
}

void LoopTargets::answer(const TargetSolution& solution) {
  refusal_.clear();
  for (const TargetSender& sender : unanswered_) admission_.accept(sender, solution);
  unanswered_.clear();
}

void LoopTargets::refuse(const control::Refusal& refusal) {
  if (refusal.fault == control::Fault::kRested) rested_.hold("", regulator::steadyNow());
  if (target_) {
    refusal_ = refusal.message;
    refused_commander_ = commander_;
  }
  for (const TargetSender& sender : unanswered_) admission_.drop(sender, refusal);
  unanswered_.clear();
  forget();
}

bool LoopTargets::areEqual(const follow::Target& a, const follow::Target& b) {
  if (a.index() != b.index()) return false;
  if (const auto* pose = std::get_if<lie::SE3>(&a)) {
    const auto& other = std::get<lie::SE3>(b);
    return pose->translation == other.translation && pose->rotation == other.rotation;
  }
  const auto* position = std::get_if<Eigen::Vector3d>(&a);
  return position ? *position == std::get<Eigen::Vector3d>(b)
                  : std::get<model::Twists>(a) == std::get<model::Twists>(b);
}

bool LoopTargets::isSilent() const {
  return (ros::SteadyTime::now() - last_target_).toSec() > scene_.safety.rules.target_timeout;
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

void LoopTargets::aimTip(const TargetSender& sender, const TipTarget& target) {
  const auto checked = seenFromBase(target);
  const TipGoal* goal = admission_.admit(sender, checked);
  if (goal == nullptr) return;
  set(sender, goal->with_rotation ? follow::Target(goal->X_BT) : goal->X_BT.translation);
}

void LoopTargets::set(const TargetSender& sender, const follow::Target& target) {
  const double pause = scene_.safety.rules.target_timeout;
  if (rested_.refuses(sender.commander, regulator::steadyNow(), pause)) {
    return admission_.drop(sender, control::restedRefusal(pause));
  }
  // A repeated target renews the lease but does not restart the watch for divergence.
  changed_ = changed_ || !target_ || !areEqual(*target_, target);
  target_ = target;
  commander_ = sender.commander;
  last_target_ = ros::SteadyTime::now();
  unanswered_.push_back(sender);
}

}  // namespace helix_arm::ros_bridge
