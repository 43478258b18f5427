#pragma once

#include <optional>
#include <string>
#include <utility>
#include <variant>
#include <vector>

#include <ros/node_handle.h>
#include <ros/time.h>

#include "helix_arm/TipTarget.h"
#include "helix_arm/control/commander_lease.hpp"
#include "helix_arm/follow/visual_servo.hpp"
#include "helix_arm/io/scene.hpp"
#include "helix_arm/regulator/regulator_io.hpp"
#include "ros_bridge/common/arm_frames.hpp"
#include "ros_bridge/common/conversions.hpp"
#include "ros_bridge/pressure/target_admission.hpp"

namespace helix_arm::ros_bridge {

/// The target that messages ask the loop for, until their sender falls silent. Each is answered on
/// target_status, when the loop has tried it. For the thread of the node's callback queue.
class LoopTargets {
 public:
  /// @param scene   As TargetAdmission's.
  /// @param frames  Outlives this.
  LoopTargets(ros::NodeHandle& node, const io::Scene& scene, const FrameLookup& frames)
      : scene_(scene),
        frames_(frames),
        admission_(
            node, scene,
            [this](const TargetSender& sender, const TipTarget& target) { aimTip(sender, target); },
            [this](const TargetSender& sender, const model::Twists& twists) {
              set(sender, twists);
            }) {}

  /// Admission of these targets, and of a commander that sends no messages.
  TargetAdmission& admission() { return admission_; }

  /// The present target, base frame; nothing where its sender was silent for
  /// safety.target_timeout_s.
  const std::optional<follow::Target>& target() {
    if (target_ && isSilent()) forget();
    return target_;
  }
  /// Whether the target is another than at the last call.
  bool takeChange() { return std::exchange(changed_, false); }
  /// Forgets the target.
  void forget() {
    target_.reset();
    commander_.clear();
    changed_ = false;
  }
  /// Who sent it, or the target that was refused; empty without either.
  const std::string& commander() const {
    return commander_.empty() && isRefused() ? refused_commander_ : commander_;
  }
  /// Why the last target was refused, until its sender falls silent; empty where it was not.
  /// Repeated targets are refused one by one: without this a status would change with each.
  std::string refusal() const { return isRefused() ? refusal_ : ""; }

  /// Answers the messages that wait for it: the loop commands the target.
  void answer(const TargetSolution& solution) {
    refusal_.clear();
    for (const TargetSender& sender : unanswered_) admission_.accept(sender, solution);
    unanswered_.clear();
  }

  /// Answers them, and forgets the target. After a rest (Fault::kRested), whoever commands must
  /// pause for safety.target_timeout before its next target counts, or the arm be enabled.
  void refuse(const control::Refusal& refusal) {
    if (refusal.fault == control::Fault::kRested) rested_.hold("", regulator::steadyNow());
    if (target_) {
      refusal_ = refusal.message;
      refused_commander_ = commander_;
    }
    for (const TargetSender& sender : unanswered_) admission_.drop(sender, refusal);
    unanswered_.clear();
    forget();
  }

  /// The arm was enabled: whoever was brought to rest may command again.
  void enabled() { rested_.release(); }

 private:
  static bool areEqual(const follow::Target& a, const follow::Target& b) {
    if (a.index() != b.index()) return false;
    if (const auto* pose = std::get_if<lie::SE3>(&a)) {
      const auto& other = std::get<lie::SE3>(b);
      return pose->translation == other.translation && pose->rotation == other.rotation;
    }
    const auto* position = std::get_if<Eigen::Vector3d>(&a);
    return position ? *position == std::get<Eigen::Vector3d>(b)
                    : std::get<model::Twists>(a) == std::get<model::Twists>(b);
  }

  bool isSilent() const {
    return (ros::SteadyTime::now() - last_target_).toSec() > scene_.safety.rules.target_timeout;
  }

  bool isRefused() const { return !refusal_.empty() && !isSilent(); }

  /// The goal of a tip target in any frame that tf knows.
  control::Checked<TipGoal> seenFromBase(const TipTarget& target) const {
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

  void aimTip(const TargetSender& sender, const TipTarget& target) {
    const auto checked = seenFromBase(target);
    const TipGoal* goal = admission_.admit(sender, checked);
    if (goal == nullptr) return;
    set(sender, goal->with_rotation ? follow::Target(goal->X_BT) : goal->X_BT.translation);
  }

  void set(const TargetSender& sender, const follow::Target& target) {
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

  const io::Scene& scene_;
  const FrameLookup& frames_;
  TargetAdmission admission_;
  control::RestedCommanders rested_;
  std::optional<follow::Target> target_;
  bool changed_ = false;
  std::string commander_;
  std::string refusal_, refused_commander_;
  ros::SteadyTime last_target_;
  std::vector<TargetSender> unanswered_;
};

}  // namespace helix_arm::ros_bridge
