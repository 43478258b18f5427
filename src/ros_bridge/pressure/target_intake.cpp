#include "helix_arm/ros_bridge/pressure/target_intake.hpp"

#include <cstdio>
#include <utility>
#include <variant>

#include "helix_arm/basics/quote.hpp"
#include "helix_arm/regulator/regulator_io.hpp"
#include "helix_arm/ros_bridge/common/diagnostics.hpp"
#include "helix_arm/ros_bridge/common/guarded_callbacks.hpp"
#include "helix_arm/ros_bridge/common/model_history.hpp"
#include "helix_arm/ros_bridge/common/names.hpp"

namespace helix_arm::ros_bridge {

TargetIntake::TargetIntake(ros::NodeHandle node, const io::Scene& scene, std::string base_frame,
                           Commands commands)
    : scene_(scene),
      base_frame_(std::move(base_frame)),
      commands_(std::move(commands)),
      solver_(scene.model),
      lease_(scene.safety.commander_timeout),
      status_publisher_(node.advertise<TargetStatus>(names::kTargetStatus, 100)),
      pressure_subscriber_(
          listen(node, names::kPressureTarget, 10, &TargetIntake::onPressureTarget, this)),
      shape_subscriber_(listen(node, names::kShapeTarget, 10, &TargetIntake::onShapeTarget, this)),
      tip_subscriber_(listen(node, names::kTipTarget, 10, &TargetIntake::onTipTarget, this)) {}

void TargetIntake::takeFromHandle(const TipTarget& target) {
  aimTip({names::kTipTarget, names::kInteractiveMarker, target.header.stamp},
         fromMsg(target, base_frame_));
}

void TargetIntake::adopt() {
  const double timeout = scene_.safety.commander_timeout;
  if (timeout != lease_.timeout()) {
    const std::string holder = lease_.holder();
    lease_ = control::CommanderLease(timeout);
    if (!holder.empty()) lease_.claim(holder, regulator::steadyNow());
  }
  solver_ = statics::InverseSolver(scene_.model);
}

diagnostic_msgs::DiagnosticStatus TargetIntake::status(const std::string& node) {
  diagnostic_msgs::DiagnosticStatus out;
  out.name = statusName(node, names::kTargetsStatus);
  ledger_.report(out);
  addValue(out, names::kLeaseHolderKey, lease_.holder());
  return out;
}

void TargetIntake::onPressureTarget(const ros::MessageEvent<const PressureArray>& event) {
  const PressureArray& target = *event.getMessage();
  const Sender sender{names::kPressureTarget, event.getPublisherName(), target.header.stamp};
  const auto checked = fresh(sender, fromMsg(target, scene_.arm, commands_.goal()));
  const Eigen::VectorXd* pressure = admit(sender, checked);
  if (pressure != nullptr && command(sender, *pressure)) {
    ledger_.reached();
    status_publisher_.publish(answerTo(sender));
  }
}

void TargetIntake::onShapeTarget(const ros::MessageEvent<const ShapeTarget>& event) {
  const ShapeTarget& target = *event.getMessage();
  const Sender sender{names::kShapeTarget, event.getPublisherName(), target.header.stamp};
  const auto checked = fresh(sender, fromMsg(target, scene_.arm.sectionCount()));
  if (const model::Twists* twists = admit(sender, checked)) {
    follow(sender, solver_.toTwists(*twists, commands_.goal()));
  }
}

void TargetIntake::onTipTarget(const ros::MessageEvent<const TipTarget>& event) {
  const TipTarget& target = *event.getMessage();
  const Sender sender{names::kTipTarget, event.getPublisherName(), target.header.stamp};
  aimTip(sender, fresh(sender, fromMsg(target, base_frame_)));
}

void TargetIntake::aimTip(const Sender& sender, const control::Checked<TipGoal>& checked) {
  if (const TipGoal* goal = admit(sender, checked)) {
    const Eigen::VectorXd from = commands_.goal();
    follow(sender, goal->with_rotation ? solver_.toPose(goal->X_BT, from)
                                       : solver_.toPosition(goal->X_BT.translation, from));
  }
}

template <class T>
control::Checked<T> TargetIntake::fresh(const Sender& sender, control::Checked<T> checked) const {
  if (sender.stamp.isZero()) return checked;
  const double age = secondsBetween(sender.stamp, ros::Time::now());
  auto refusal = control::checkAge(age, scene_.safety.rules.target_timeout);
  return refusal ? control::Checked<T>(*refusal) : checked;
}

template <class T>
const T* TargetIntake::admit(const Sender& sender, const control::Checked<T>& checked) {
  // Checked before the lease: nonsense neither takes nor keeps it.
  if (const auto* refusal = std::get_if<control::Refusal>(&checked)) {
    drop(sender, *refusal);
    return nullptr;
  }
  if (!lease_.claim(sender.commander, regulator::steadyNow())) {
    char text[256];
    std::snprintf(text, sizeof text,
                  "%s commands the arm; stop it and wait for %g s (safety.commander_timeout_s)",
                  basics::quoted(lease_.holder()).c_str(), lease_.timeout());
    drop(sender, {control::Fault::kOtherCommander, text});
    return nullptr;
  }
  return &std::get<T>(checked);
}

void TargetIntake::drop(const Sender& sender, const control::Refusal& refusal) {
  ledger_.dropped(sender.topic, sender.commander, refusal);
  TargetStatus status = answerTo(sender);
  status.outcome = TargetStatus::DROPPED;
  status.fault = control::nameOf(refusal.fault);
  status.message = refusal.message;
  status_publisher_.publish(status);
}

void TargetIntake::follow(const Sender& sender, const statics::InverseResult& result) {
  if (!result.converged()) {
    drop(sender, {control::Fault::kNotConverged,
                  "no pressures were found for it; send a target closer to the arm's shape"});
    return;
  }
  if (!command(sender, result.input)) return;
  TargetStatus status = answerTo(sender);
  status.residual = result.residual;
  status.position_error = result.position_error;
  for (int i = 0; i < scene_.arm.actuatorCount(); ++i) {
    const std::string& name = scene_.arm.actuator(i).name;
    if (result.limits[i] == statics::Limit::kLower) status.at_lower_limit.push_back(name);
    if (result.limits[i] == statics::Limit::kUpper) status.at_upper_limit.push_back(name);
  }
  if (result.status == statics::InverseStatus::kReached) {
    ledger_.reached();
  } else {
    char text[160];
    std::snprintf(text, sizeof text,
                  "the tip stays %.1f mm away, residual %.2g m; the closest shape is commanded",
                  1e3 * result.position_error, result.residual);
    ledger_.unreachable(sender.topic, sender.commander, text);
    status.outcome = TargetStatus::UNREACHABLE;
    status.message = text;
  }
  status_publisher_.publish(status);
}

bool TargetIntake::command(const Sender& sender, const Eigen::VectorXd& pressure) {
  const std::string refusal = commands_.send(pressure);
  if (!refusal.empty()) drop(sender, {control::Fault::kNotEnabled, refusal});
  return refusal.empty();
}

TargetStatus TargetIntake::answerTo(const Sender& sender) const {
  TargetStatus status;
  status.header.stamp = ros::Time::now();
  status.target_stamp = sender.stamp;
  status.topic = sender.topic;
  status.commander = sender.commander;
  status.outcome = TargetStatus::REACHED;
  return status;
}

}  // namespace helix_arm::ros_bridge
