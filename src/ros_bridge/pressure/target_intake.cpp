#include "ros_bridge/pressure/target_intake.hpp"

#include <algorithm>
#include <utility>

#include "helix_arm/regulator/regulator_io.hpp"
#include "ros_bridge/common/guarded_callbacks.hpp"
#include "ros_bridge/common/names.hpp"

namespace helix_arm::ros_bridge {

TargetIntake::TargetIntake(ros::NodeHandle node, const io::Scene& scene, std::string base_frame,
                           const model::ArmResponse& response, Commands commands)
    : scene_(scene),
      base_frame_(std::move(base_frame)),
      response_(response),
      commands_(std::move(commands)),
      solver_(scene.model),
      lower_(scene.arm.inputAt(0)),
      upper_(lower_),
      admission_(node, scene),
      pressure_subscriber_(
          listen(node, names::kPressureTarget, 10, &TargetIntake::onPressureTarget, this)),
      shape_subscriber_(listen(node, names::kShapeTarget, 10, &TargetIntake::onShapeTarget, this)),
      tip_subscriber_(listen(node, names::kTipTarget, 10, &TargetIntake::onTipTarget, this)) {}

void TargetIntake::takeFromHandle(const TipTarget& target) {
  aimTip({names::kTipTarget, names::kInteractiveMarker, target.header.stamp},
         fromMsg(target, base_frame_));
}

void TargetIntake::adopt() {
  admission_.adopt();
  solver_ = statics::InverseSolver(scene_.model);
}

diagnostic_msgs::DiagnosticStatus TargetIntake::status(const std::string& node) {
  return admission_.status(node);
}

void TargetIntake::onPressureTarget(const ros::MessageEvent<const PressureArray>& event) {
  const PressureArray& target = *event.getMessage();
  const TargetSender sender{names::kPressureTarget, event.getPublisherName(), target.header.stamp};
  const auto checked = admission_.fresh(sender, fromMsg(target, scene_.arm, commands_.goal()));
  const Eigen::VectorXd* pressure = admission_.admit(sender, checked);
  if (pressure == nullptr || !command(sender, *pressure)) return;
  admission_.accept(sender);
  const auto largest = std::max_element(target.pressure.begin(), target.pressure.end());
  if (largest != target.pressure.end()) {
    units_.note(regulator::steadyNow(), sender.commander, *largest);
  }
}

std::string TargetIntake::unitWarning() { return units_.warning(regulator::steadyNow()); }

void TargetIntake::onShapeTarget(const ros::MessageEvent<const ShapeTarget>& event) {
  const ShapeTarget& target = *event.getMessage();
  const TargetSender sender{names::kShapeTarget, event.getPublisherName(), target.header.stamp};
  const auto checked = admission_.fresh(sender, fromMsg(target, scene_.arm.sectionCount()));
  if (const model::Twists* twists = admission_.admit(sender, checked)) {
    const Eigen::VectorXd from = beginSearch();
    follow(sender, solver_.toTwists(*twists, from));
  }
}

void TargetIntake::onTipTarget(const ros::MessageEvent<const TipTarget>& event) {
  const TipTarget& target = *event.getMessage();
  const TargetSender sender{names::kTipTarget, event.getPublisherName(), target.header.stamp};
  aimTip(sender, admission_.fresh(sender, fromMsg(target, base_frame_)));
}

void TargetIntake::aimTip(const TargetSender& sender, const control::Checked<TipGoal>& checked) {
  if (const TipGoal* goal = admission_.admit(sender, checked)) {
    const Eigen::VectorXd from = beginSearch();
    follow(sender, goal->with_rotation ? solver_.toPose(goal->X_BT, from)
                                       : solver_.toPosition(goal->X_BT.translation, from));
  }
}

Eigen::VectorXd TargetIntake::beginSearch() {
  if (response_.instant()) return commands_.goal();
  response_.effectiveLimits(scene_.arm, lower_, upper_);
  solver_.limit(lower_, upper_);
  return response_.effectiveAt(commands_.goal()).cwiseMax(lower_).cwiseMin(upper_);
}

void TargetIntake::follow(const TargetSender& sender, const statics::InverseResult& result) {
  Eigen::VectorXd pressure = result.input;
  if (!response_.instant()) response_.inputsFor(scene_.arm, result.input, pressure);
  if (!result.converged()) {
    admission_.drop(sender, notConverged());
  } else if (command(sender, pressure)) {
    admission_.accept(sender,
                      {result.status, result.residual, result.position_error, result.limits});
  }
}

bool TargetIntake::command(const TargetSender& sender, const Eigen::VectorXd& pressure) {
  const auto refusal = commands_.send(sender.commander, pressure);
  if (refusal) admission_.drop(sender, *refusal);
  return !refusal;
}

}  // namespace helix_arm::ros_bridge
