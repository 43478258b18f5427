#pragma once

#include <optional>
#include <string>
#include <vector>

#include <geometry_msgs/PoseStamped.h>
#include <ros/message_event.h>
#include <ros/node_handle.h>
#include <ros/time.h>

#include "helix_arm/ShapeTarget.h"
#include "helix_arm/TipTarget.h"
#include "helix_arm/control/commander_lease.hpp"
#include "helix_arm/follow/visual_servo.hpp"
#include "helix_arm/io/scene.hpp"
#include "ros_bridge/common/arm_frames.hpp"
#include "ros_bridge/common/conversions.hpp"
#include "ros_bridge/pressure/target_intake.hpp"

namespace helix_arm::ros_bridge {

/// The target that messages ask the loop for, until their sender falls silent.
///
/// Subscribes to tip_target, tip_pose and shape_target; answers each on target_status, when the
/// loop has tried it. For the thread of the node's callback queue.
class LoopTargets {
 public:
  /// @param scene   Kept by reference: after a change to it, call adopt() before the next target.
  /// @param frames  Outlives this.
  LoopTargets(ros::NodeHandle& node, const io::Scene& scene, const FrameLookup& frames);

  /// A target from the interactive marker, whose stamp is not checked.
  void takeFromHandle(const TipTarget& target);

  /// Follows a change of the scene. Whoever holds the lease keeps it.
  void adopt() { admission_.adopt(); }

  /// The present target, base frame; nothing where its sender was silent for
  /// safety.target_timeout_s.
  const std::optional<follow::Target>& target() {
    const double silence = (ros::SteadyTime::now() - last_target_).toSec();
    if (target_ && silence > scene_.safety.rules.target_timeout) forget();
    return target_;
  }
  /// Whether the target is another than at the last call.
  bool takeChange() {
    const bool changed = changed_;
    changed_ = false;
    return changed;
  }
  /// Forgets the target.
  void forget() {
    target_.reset();
    commander_.clear();
    changed_ = false;
  }
  /// Who sent it; empty without a target.
  const std::string& commander() const { return commander_; }

  /// Grants or renews the lease of a commander that sends no messages, or says who holds it.
  std::optional<control::Refusal> claim(const std::string& commander) {
    return admission_.claim(commander);
  }

  /// Whether messages wait for an answer.
  bool areUnanswered() const { return !unanswered_.empty(); }
  /// Answers them: the loop commands the target.
  void answer(const TargetSolution& solution);
  /// Answers them, and forgets the target. After a rest (Fault::kRested), its commander must pause
  /// for safety.target_timeout before its next target counts, or the arm be enabled (enabled()).
  void refuse(const control::Refusal& refusal);
  /// The arm was enabled: whoever was brought to rest may command again.
  void enabled() { rested_.release(); }

  /// As TargetAdmission::status().
  diagnostic_msgs::DiagnosticStatus status() { return admission_.status(); }

 private:
  void onTipTarget(const ros::MessageEvent<const TipTarget>& event);
  void onTipPose(const ros::MessageEvent<const geometry_msgs::PoseStamped>& event);
  void onShapeTarget(const ros::MessageEvent<const ShapeTarget>& event);
  /// The goal of a tip target in any frame that tf knows.
  control::Checked<TipGoal> seenFromBase(const TipTarget& target) const;
  void aimTip(const TargetSender& sender, const control::Checked<TipGoal>& checked);
  void set(const TargetSender& sender, const follow::Target& target);

  const io::Scene& scene_;
  const FrameLookup& frames_;
  TargetAdmission admission_;
  control::RestedCommander rested_;
  std::optional<follow::Target> target_;
  bool changed_ = false;
  std::string commander_;
  ros::SteadyTime last_target_;
  std::vector<TargetSender> unanswered_;
  ros::Subscriber tip_subscriber_, pose_subscriber_, shape_subscriber_;
};

}  // namespace helix_arm::ros_bridge
