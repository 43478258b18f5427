#pragma once

#include <optional>
#include <string>
#include <vector>

#include <ros/node_handle.h>
#include <ros/time.h>

#include "helix_arm/TipTarget.h"
#include "helix_arm/control/commander_lease.hpp"
#include "helix_arm/follow/visual_servo.hpp"
#include "helix_arm/io/scene.hpp"
#include "regulator/regulator_io.hpp"
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
  const std::optional<follow::Target>& target();
  /// Whether the target is another than at the last call.
  bool takeChange() { return std::exchange(changed_, false); }
  /// Forgets the target.
  void forget();
  /// Who sent it, or the target that was refused; empty without either.
  const std::string& commander() const;
  /// Why the last target was refused, until its sender falls silent; empty where it was not.
  /// Repeated targets are refused one by one: without this a status would change with each.
  std::string refusal() const { return isRefused() ? refusal_ : ""; }

  /// Answers the messages that wait for it: the loop commands the target.
  void answer(const TargetSolution& solution);

  /// Answers them, and forgets the target. After a rest (Fault::kRested), whoever commands must
  /// pause for safety.target_timeout before its next target counts, or the arm be enabled.
  void refuse(const control::Refusal& refusal);

  /// The arm was enabled: whoever was brought to rest may command again.
  void enabled() { rested_.release(); }

 private:
  static bool areEqual(const follow::Target& a, const follow::Target& b);
  bool isSilent() const;
  bool isRefused() const { return !refusal_.empty() && !isSilent(); }

  /// The goal of a tip target in any frame that tf knows.
  control::Checked<TipGoal> seenFromBase(const TipTarget& target) const;
  void aimTip(const TargetSender& sender, const TipTarget& target);
  void set(const TargetSender& sender, const follow::Target& target);

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
