#pragma once

#include <algorithm>
#include <string>

#include <ros/node_handle.h>

#include "helix_arm/PressureArray.h"
#include "helix_arm/TipTarget.h"
#include "helix_arm/control/target_check.hpp"
#include "helix_arm/io/scene.hpp"
#include "helix_arm/model/arm_response.hpp"
#include "helix_arm/statics/inverse.hpp"
#include "keep_out_gate.hpp"
#include "pressure_loop.hpp"
#include "regulator/realtime.hpp"
#include "ros_bridge/common/conversions.hpp"
#include "ros_bridge/common/guarded_callbacks.hpp"
#include "ros_bridge/names.hpp"
#include "target_admission.hpp"

namespace helix_arm::ros_bridge {

/// From a target to a command: checks its values and its stamp, then whether its sender may command
/// the arm, turns shapes and tips into pressures, and commands them.
///
/// Subscribes to pressure_target, and by its TargetAdmission to the targets of tip and shape. A
/// target that is not sound, or whose sender may not command, is counted and dropped, and the
/// command stays. All of it belongs to the thread of the node's callback queue.
class TargetIntake {
 public:
  /// @param scene       Kept by reference: after a change, call adopt() before the next target.
  /// @param base_frame  Frame of tip targets.
  /// @param response    Of the arm, as it has followed the measured pressures. Kept by reference.
  /// @param loop        Takes accepted targets.
  /// @param gate        The loop's, whose nearest zone is told. Kept by reference.
  TargetIntake(ros::NodeHandle node, const io::Scene& scene, std::string base_frame,
               const model::ArmResponse& response, PressureLoop& loop, const KeepOutGate& gate)
      : scene_(scene),
        base_frame_(std::move(base_frame)),
        response_(response),
        loop_(loop),
        gate_(gate),
        solver_(scene.model),
        lower_(scene.arm.inputAt(0)),
        upper_(lower_),
        admission_(
            node, scene,
            [this](const TargetSender& sender, const TipTarget& target) { aimTip(sender, target); },
            [this](const TargetSender& sender, const model::Twists& twists) {
              follow(sender, solver_.toTwists(twists, beginSearch()));
            }),
        subscriber_(listen<PressureArray>(node, names::kPressureTarget, 10,
                                          [this](const auto& event) { onPressureTarget(event); })) {
  }

  /// Follows a change of the scene. Whoever holds the lease keeps it.
  void adopt() {
    admission_.adopt();
    solver_ = statics::InverseSolver(scene_.model);
  }

  /// A warning about a commander whose pressures look like kPa, once for each; else empty.
  std::string unitWarning() { return units_.warning(regulator::steadyNow()); }

  TargetAdmission& admission() { return admission_; }

 private:
  void onPressureTarget(const ros::MessageEvent<const PressureArray>& event) {
    const PressureArray& target = *event.getMessage();
    const TargetSender sender(names::kPressureTarget, event);
    const auto checked =
        control::checkPressures(scene_.arm, loop_.goal(), target.name, target.pressure);
    const Eigen::VectorXd* pressure = admission_.admit(sender, checked);
    if (pressure == nullptr || !command(sender, *pressure)) return;
    admission_.accept(sender);
    const auto largest = std::max_element(target.pressure.begin(), target.pressure.end());
    if (largest != target.pressure.end())
      units_.note(regulator::steadyNow(), sender.commander, *largest);
  }

  void aimTip(const TargetSender& sender, const TipTarget& target) {
    const auto checked = fromMsg(target, base_frame_);
    if (const TipGoal* goal = admission_.admit(sender, checked)) {
      const Eigen::VectorXd from = beginSearch();
      follow(sender, goal->with_rotation ? solver_.toPose(goal->X_BT, from)
                                         : solver_.toPosition(goal->X_BT.translation, from));
    }
  }

  /// The command's effective pressure. Limits the search to attainable effective pressures.
  Eigen::VectorXd beginSearch() {
    if (response_.instant()) return loop_.goal();
    response_.effectiveLimits(scene_.arm, lower_, upper_, kTargetAt);
    solver_.limit(lower_, upper_);
    return response_.effectiveAt(loop_.goal(), kTargetAt).cwiseMax(lower_).cwiseMin(upper_);
  }

  /// Goes to where the result's pressures are effective.
  void follow(const TargetSender& sender, const statics::InverseResult& result) {
    Eigen::VectorXd pressure = result.input;
    if (!response_.instant()) response_.inputsFor(scene_.arm, result.input, pressure, kTargetAt);
    if (result.converged() && !command(sender, pressure)) return;
    admission_.accept(sender,
                      {result.status, result.residual, result.position_error, result.limits});
  }

  /// Commands it; else drops the target and returns false.
  bool command(const TargetSender& sender, const Eigen::VectorXd& pressure) {
    const auto refusal = loop_.command(sender.commander, pressure);
    admission_.tell(gate_.nearest());
    if (refusal) admission_.drop(sender, *refusal);
    return !refusal;
  }

  const io::Scene& scene_;
  const std::string base_frame_;
  const model::ArmResponse& response_;
  PressureLoop& loop_;
  const KeepOutGate& gate_;
  statics::InverseSolver solver_;
  Eigen::VectorXd lower_, upper_;  // of effective pressures
  TargetAdmission admission_;
  control::UnitWatch units_;
  const ros::Subscriber subscriber_;
};

}  // namespace helix_arm::ros_bridge
