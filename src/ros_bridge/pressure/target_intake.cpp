#include "target_intake.hpp"

#include <cstdio>

#include "helix_arm/basics/quote.hpp"
#include "helix_arm/regulator/regulator_io.hpp"
#include "ros_bridge/common/guarded_callbacks.hpp"
#include "ros_bridge/common/log.hpp"
#include "ros_bridge/common/model_history.hpp"
#include "ros_bridge/names.hpp"

namespace helix_arm::ros_bridge {

namespace {

TargetStatus answerTo(const TargetSender& sender) {
  TargetStatus status;
  status.header.stamp = ros::Time::now();
  status.target_stamp = sender.stamp;
  status.topic = sender.topic;
  status.commander = sender.commander;
  status.outcome = TargetStatus::REACHED;
  return status;
}

}  // namespace

control::Refusal notConverged() {
  return {control::Fault::kNotConverged,
          "no pressures were found for it; send a target closer to the arm's shape"};
}

TargetAdmission::TargetAdmission(ros::NodeHandle& node, const io::Scene& scene)
    : scene_(scene),
      lease_(scene.safety.commander_timeout),
      publisher_(node.advertise<TargetStatus>(names::kTargetStatus, 100)) {}

void TargetAdmission::adopt() {
  const double timeout = scene_.safety.commander_timeout;
  if (timeout == lease_.timeout()) return;
  const std::string holder = lease_.holder();
  lease_ = control::CommanderLease(timeout);
  if (!holder.empty()) lease_.claim(holder, regulator::steadyNow());
}

std::optional<control::Refusal> TargetAdmission::ageRefusal(const TargetSender& sender) const {
  if (sender.stamp.isZero()) return std::nullopt;
  const double age = secondsBetween(sender.stamp, ros::Time::now());
  return control::checkAge(age, scene_.safety.rules.target_timeout);
}

std::optional<control::Refusal> TargetAdmission::claim(const std::string& commander) {
  if (lease_.claim(commander, regulator::steadyNow())) return std::nullopt;
  char text[256];
  std::snprintf(text, sizeof text,
                "%s commands the arm; stop it and wait for %g s (safety.commander_timeout_s)",
                basics::quoted(lease_.holder()).c_str(), lease_.timeout());
  return control::Refusal{control::Fault::kOtherCommander, text};
}

void TargetAdmission::warn(FaultCount& count, const TargetSender& sender,
                           const std::string& message, const char* consequence) {
  news_ = true;
  last_fault_ = sender.topic + " from " + basics::quoted(sender.commander) + ": " + message;
  if (!count.add()) return;
  logWarning("%s (%s, %lu so far)", last_fault_.c_str(), consequence, count.total());
}

void TargetAdmission::drop(const TargetSender& sender, const control::Refusal& refusal) {
  warn(dropped_[static_cast<std::size_t>(refusal.fault)], sender, refusal.message, "dropped");
  TargetStatus status = answerTo(sender);
  status.outcome = TargetStatus::DROPPED;
  status.fault = control::nameOf(refusal.fault);
  status.message = refusal.message;
  publisher_.publish(status);
}

void TargetAdmission::accept(const TargetSender& sender) {
  ++reached_;
  publisher_.publish(answerTo(sender));
}

void TargetAdmission::accept(const TargetSender& sender, const TargetSolution& solution) {
  TargetStatus status = answerTo(sender);
  status.residual = solution.residual;
  status.position_error = solution.position_error;
  status.at_lower_limit = namesAt(statics::Limit::kLower, scene_.arm, solution.limits);
  status.at_upper_limit = namesAt(statics::Limit::kUpper, scene_.arm, solution.limits);
  if (solution.status == statics::InverseStatus::kReached) {
    ++reached_;
  } else {
    char text[160];
    std::snprintf(text, sizeof text,
                  "out of reach: the tip stays %.1f mm away; the closest shape is commanded",
                  1e3 * solution.position_error);
    warn(unreachable_, sender, text, "out of reach");
    status.outcome = TargetStatus::UNREACHABLE;
    status.message = text;
  }
  publisher_.publish(status);
}

diagnostic_msgs::DiagnosticStatus TargetAdmission::status() {
  using diagnostic_msgs::DiagnosticStatus;
  unsigned long total = 0;
  for (const FaultCount& count : dropped_) total += count.total();
  DiagnosticStatus out =
      makeStatus(names::kTargetsStatus, news_ ? DiagnosticStatus::WARN : DiagnosticStatus::OK,
                 news_ ? last_fault_ : "no target was dropped or out of reach",
                 {{"reached", std::to_string(reached_)},
                  {names::kUnreachableKey, std::to_string(unreachable_.total())},
                  {names::kDroppedKey, std::to_string(total)}});
  for (int i = 0; i < control::kFaultCount; ++i) {
    addValue(out, names::kDroppedPrefix + std::string(control::nameOf(control::Fault(i))),
             std::to_string(dropped_[i].total()));
  }
  addValue(out, names::kLastFaultKey, last_fault_);
  addValue(out, names::kLeaseHolderKey, lease_.holder());
  news_ = false;
  return out;
}

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

}  // namespace helix_arm::ros_bridge
