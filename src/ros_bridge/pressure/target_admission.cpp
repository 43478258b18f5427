#include "ros_bridge/pressure/target_admission.hpp"

#include <cstdio>

#include "helix_arm/basics/quote.hpp"
#include "helix_arm/regulator/regulator_io.hpp"
#include "ros_bridge/common/diagnostics.hpp"
#include "ros_bridge/common/model_history.hpp"
#include "ros_bridge/common/names.hpp"

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

void TargetAdmission::drop(const TargetSender& sender, const control::Refusal& refusal) {
  ledger_.dropped(sender.topic, sender.commander, refusal);
  TargetStatus status = answerTo(sender);
  status.outcome = TargetStatus::DROPPED;
  status.fault = control::nameOf(refusal.fault);
  status.message = refusal.message;
  publisher_.publish(status);
}

void TargetAdmission::accept(const TargetSender& sender) {
  ledger_.reached();
  publisher_.publish(answerTo(sender));
}

void TargetAdmission::accept(const TargetSender& sender, const TargetSolution& solution) {
  TargetStatus status = answerTo(sender);
  status.residual = solution.residual;
  status.position_error = solution.position_error;
  for (int i = 0; i < scene_.arm.actuatorCount(); ++i) {
    const std::string& name = scene_.arm.actuator(i).name;
    const statics::Limit limit = solution.limits[static_cast<std::size_t>(i)];
    if (limit == statics::Limit::kLower) status.at_lower_limit.push_back(name);
    if (limit == statics::Limit::kUpper) status.at_upper_limit.push_back(name);
  }
  if (solution.status == statics::InverseStatus::kReached) {
    ledger_.reached();
  } else {
    char text[160];
    std::snprintf(text, sizeof text,
                  "out of reach: the tip stays %.1f mm away; the closest shape is commanded",
                  1e3 * solution.position_error);
    ledger_.unreachable(sender.topic, sender.commander, text);
    status.outcome = TargetStatus::UNREACHABLE;
    status.message = text;
  }
  publisher_.publish(status);
}

diagnostic_msgs::DiagnosticStatus TargetAdmission::status(const std::string& node) {
  diagnostic_msgs::DiagnosticStatus out;
  out.name = statusName(node, names::kTargetsStatus);
  ledger_.report(out);
  addValue(out, names::kLeaseHolderKey, lease_.holder());
  return out;
}

}  // namespace helix_arm::ros_bridge
