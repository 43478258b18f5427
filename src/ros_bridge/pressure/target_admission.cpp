#include "target_admission.hpp"

#include <utility>

#include "basics/quote.hpp"
#include "basics/text.hpp"
#include "helix_arm/ShapeTarget.h"
#include "regulator/regulator_io.hpp"
#include "ros_bridge/common/conversions.hpp"
#include "ros_bridge/common/guarded_callbacks.hpp"
#include "ros_bridge/names.hpp"

namespace helix_arm::ros_bridge {
namespace {

// A pose as the target of a tip: its position alone where the orientation is all 0.
TipTarget toTipTarget(const geometry_msgs::PoseStamped& pose) {
  TipTarget target;
  target.header = pose.header;
  const geometry_msgs::Quaternion& q = pose.pose.orientation;
  const bool is_set = !Eigen::Vector4d(q.x, q.y, q.z, q.w).isZero(0);
  target.mode = is_set ? TipTarget::POSE : TipTarget::POSITION;
  target.pose = pose.pose;
  return target;
}

}  // namespace

TargetStatus TargetAdmission::answerTo(const TargetSender& sender) const {
  TargetStatus status;
  status.header.stamp = ros::Time::now();
  status.target_stamp = sender.stamp;
  status.topic = sender.topic;
  status.commander = sender.commander;
  status.outcome = TargetStatus::REACHED;
  status.clearance = nearest_.clearance;
  status.zone = nearest_.zone;
  status.has_clear_tip = nearest_.clear_tip.has_value();
  if (nearest_.clear_tip) status.clear_tip = toPointMsg(*nearest_.clear_tip);
  return status;
}

TargetSender::TargetSender(const ros::Time& time)
    : topic(names::kTipTarget), commander(names::kInteractiveMarker), stamp(time), ages(false) {}

TargetAdmission::TargetAdmission(ros::NodeHandle& node, const io::Scene& scene, AimTip aim_tip,
                                 const AimShape& aim_shape)
    : scene_(scene),
      aim_tip_(std::move(aim_tip)),
      lease_(scene.safety.commander_timeout),
      publisher_(node.advertise<TargetStatus>(names::kTargetStatus, 100)) {
  tip_subscriber_ = listen<TipTarget>(node, names::kTipTarget, 10, [this](const auto& event) {
    aim_tip_({names::kTipTarget, event}, *event.getMessage());
  });
  pose_subscriber_ = listen<geometry_msgs::PoseStamped>(
      node, names::kTipTargetPose, 10, [this](const auto& event) {
        aim_tip_({names::kTipTargetPose, event}, toTipTarget(*event.getMessage()));
      });
  shape_subscriber_ =
      listen<ShapeTarget>(node, names::kShapeTarget, 10, [this, aim_shape](const auto& event) {
        const TargetSender sender(names::kShapeTarget, event);
        const int sections = scene_.arm.sectionCount();
        const auto checked = control::checkTwists(sections, event.getMessage()->twist);
        if (const model::Twists* twists = admit(sender, checked)) aim_shape(sender, *twists);
      });
}

void TargetAdmission::adopt() {
  const double timeout = scene_.safety.commander_timeout;
  if (timeout == lease_.timeout()) return;
  const std::string holder = lease_.holder();
  lease_ = control::CommanderLease(timeout);
  if (!holder.empty()) lease_.claim(holder, regulator::steadyNow());
}

std::optional<control::Refusal> TargetAdmission::refusalOf(const TargetSender& sender,
                                                           const control::Refusal* of_value) {
  if (sender.ages && !sender.stamp.isZero()) {
    const double age = secondsBetween(sender.stamp, ros::Time::now());
    if (auto stale = control::checkAge(age, scene_.safety.rules.target_timeout)) return stale;
  }
  // Checked before the lease: nonsense neither takes nor keeps it.
  if (of_value != nullptr) return *of_value;
  return claim(sender.commander);
}

std::optional<control::Refusal> TargetAdmission::claim(const std::string& commander) {
  if (lease_.claim(commander, regulator::steadyNow())) return std::nullopt;
  return control::Refusal{
      control::Fault::kOtherCommander,
      basics::format("%s commands the arm; stop it and wait for %g s (safety.commander_timeout_s)",
                     basics::quoted(lease_.holder()).c_str(), lease_.timeout())};
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
  if (solution.status == statics::InverseStatus::kNotConverged) {
    return drop(sender,
                {control::Fault::kNotConverged,
                 "no pressures were found for it; send a target closer to the arm's shape"});
  }
  TargetStatus status = answerTo(sender);
  status.residual = solution.residual;
  status.position_error = solution.position_error;
  status.at_lower_limit = namesAt(statics::Limit::kLower, scene_.arm, solution.limits);
  status.at_upper_limit = namesAt(statics::Limit::kUpper, scene_.arm, solution.limits);
  if (solution.status == statics::InverseStatus::kReached) {
    ++reached_;
  } else {
    status.outcome = TargetStatus::UNREACHABLE;
    status.message =
        basics::format("out of reach: the tip stays %.1f mm away; the closest shape is commanded",
                       1e3 * solution.position_error);
    warn(unreachable_, sender, status.message, "out of reach");
  }
  publisher_.publish(status);
}

diagnostic_msgs::DiagnosticStatus TargetAdmission::status() {
  using diagnostic_msgs::DiagnosticStatus;
  unsigned long total = 0;
  for (const FaultCount& count : dropped_) total += count.total();
  DiagnosticStatus out =
      makeStatus("targets", news_ ? DiagnosticStatus::WARN : DiagnosticStatus::OK,
                 news_ ? last_fault_ : "no target was dropped or out of reach",
                 {{"reached", std::to_string(reached_)},
                  {"unreachable", std::to_string(unreachable_.total())},
                  {"dropped", std::to_string(total)}});
  for (int i = 0; i < control::kFaultCount; ++i) {
    addValue(out, "dropped_" + std::string(control::nameOf(control::Fault(i))),
             std::to_string(dropped_[i].total()));
  }
  addValue(out, names::kLastFaultKey, last_fault_);
  addValue(out, "lease_holder", lease_.isFree(regulator::steadyNow()) ? "" : lease_.holder());
  news_ = false;
  return out;
}

}  // namespace helix_arm::ros_bridge
