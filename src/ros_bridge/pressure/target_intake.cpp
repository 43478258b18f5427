#include "target_intake.hpp"

#include <algorithm>

#include "ros_bridge/common/conversions.hpp"
#include "ros_bridge/common/guarded_callbacks.hpp"
#include "ros_bridge/names.hpp"

namespace helix_arm::ros_bridge {

TargetIntake::TargetIntake(ros::NodeHandle node, const io::Scene& scene, std::string base_frame,
                           const model::ArmResponse& response, PressureLoop& loop,
                           const KeepOutGate& gate)
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
      subscriber_(listen(node, names::kPressureTarget, 10, &TargetIntake::onPressureTarget, this)) {
}

void TargetIntake::adopt() {
  admission_.adopt();
  solver_ = statics::InverseSolver(scene_.model);
}

void TargetIntake::onPressureTarget(const ros::MessageEvent<const PressureArray>& event) {
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

void TargetIntake::aimTip(const TargetSender& sender, const TipTarget& target) {
  const auto checked = fromMsg(target, base_frame_);
  if (const TipGoal* goal = admission_.admit(sender, checked)) {
    const Eigen::VectorXd from = beginSearch();
    follow(sender, goal->with_rotation ? solver_.toPose(goal->X_BT, from)
                                       : solver_.toPosition(goal->X_BT.translation, from));
  }
}

Eigen::VectorXd TargetIntake::beginSearch() {
  if (response_.instant()) return loop_.goal();
  response_.effectiveLimits(scene_.arm, lower_, upper_, kTargetAt);
  solver_.limit(lower_, upper_);
  return response_.effectiveAt(loop_.goal(), kTargetAt).cwiseMax(lower_).cwiseMin(upper_);
}

void TargetIntake::follow(const TargetSender& sender, const statics::InverseResult& result) {
  Eigen::VectorXd pressure = result.input;
  if (!response_.instant()) response_.inputsFor(scene_.arm, result.input, pressure, kTargetAt);
  if (result.converged() && !command(sender, pressure)) return;
  admission_.accept(sender, {result.status, result.residual, result.position_error, result.limits});
}

bool TargetIntake::command(const TargetSender& sender, const Eigen::VectorXd& pressure) {
  const auto refusal = loop_.command(sender.commander, pressure);
  admission_.tell(gate_.nearest());
  if (refusal) admission_.drop(sender, *refusal);
  return !refusal;
}

}  // namespace helix_arm::ros_bridge
