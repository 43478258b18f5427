// What CockpitLink hears.
#include <cmath>
#include <cstdlib>
#include <utility>

#include <ros/this_node.h>

#include "ros_bridge/cockpit/calibration_use.hpp"
#include "ros_bridge/cockpit/cockpit_link.hpp"
#include "ros_bridge/cockpit/cockpit_words.hpp"
#include "ros_bridge/common/diagnostics.hpp"
#include "ros_bridge/common/names.hpp"

namespace helix_arm::ros_bridge {
namespace {

constexpr std::size_t kMostChannels = 64, kMostWarnings = 8;

bool isSound(const PressureArray& array) {
  return !array.name.empty() && array.name.size() == array.pressure.size() &&
         array.name.size() <= kMostChannels;
}

std::vector<double> tipPositionOf(const ArmShape& shape) {
  const auto& p = shape.tip.position;
  return {p.x, p.y, p.z};
}

// Sum of the sections' lengths; the speed along a constant twist is |v|.
double lengthOf(const ArmShape& shape) {
  double out = 0;
  for (std::size_t i = 0; i + 6 <= shape.twist.size(); i += 6) {
    out += std::hypot(shape.twist[i], shape.twist[i + 1], shape.twist[i + 2]);
  }
  return out;
}

double numberOf(const diagnostic_msgs::DiagnosticStatus& status, const char* key) {
  const std::string text = valueOf(status, key);
  return text.empty() ? kUnknown : std::strtod(text.c_str(), nullptr);
}

// The value of a key in kPa, in Pa.
double pascalsOf(const diagnostic_msgs::DiagnosticStatus& status, const char* key) {
  return 1e3 * numberOf(status, key);
}

}  // namespace

void CockpitLink::onFeedback(std::uint64_t run, const RunCalibrationFeedback& feedback) {
  const basics::MutexLock lock(mutex_);
  if (run != runs_ || !calibration_.running) return;
  calibration_.step = feedback.step;
  calibration_.steps = feedback.steps;
  calibration_.samples = feedback.samples;
  calibration_.state = shownText(feedback.state);
}

void CockpitLink::onResult(std::uint64_t run, const RunCalibrationResult* result,
                           const actionlib::SimpleClientGoalState& ending) {
  const basics::MutexLock lock(mutex_);
  if (run != runs_ || !calibration_.running) return;  // it was given up on
  calibration_.running = false;
  calibration_.ended = true;
  calibration_.cancelled = ending == actionlib::SimpleClientGoalState::PREEMPTED;
  if (result == nullptr) {
    calibration_.message = "the calibration node ended (" + ending.toString() + ")";
    return;
  }
  calibration_.success = result->success != 0;
  calibration_.message = shownText(result->message);
  calibration_.tip_error_before = result->tip_error_before;
  calibration_.tip_error_after = result->tip_error_after;
  calibration_.parameters = parameterLines(*result);
  calibration_.warnings.clear();
  for (const std::string& warning : result->warnings) {
    if (calibration_.warnings.size() == kMostWarnings) break;
    calibration_.warnings.push_back(shownText(warning));
  }
}

void CockpitLink::onCommand(const PressureArrayConstPtr& message) {
  if (!isSound(*message)) return;
  const basics::MutexLock lock(mutex_);
  if (message->name != command_.value.name) {
    if (held_.goal() != CockpitGoal::kNone) held_.end("the arm has other actuators now");
  }
  command_.set(*message);
}

void CockpitLink::onPressures(const PressureArrayConstPtr& message) {
  if (!isSound(*message)) return;
  const basics::MutexLock lock(mutex_);
  pressures_.set(*message);
}

void CockpitLink::onSafety(const SafetyStateConstPtr& message) {
  CockpitSafety safety;
  safety.state = shownText(message->state);
  safety.cause = shownText(message->cause);
  safety.problem = shownText(message->problem);
  safety.action = shownText(message->action);
  safety.remedy = shownText(message->remedy);
  safety.reason = shownText(message->reason);
  safety.resting = message->resting != 0;
  safety.stopped = message->stopped != 0;
  safety.vent_overdue = message->vent_overdue != 0;
  const basics::MutexLock lock(mutex_);
  held_.noteState(message->state == SafetyState::ENABLED, safety.reason);
  safety_.set(std::move(safety));
}

void CockpitLink::onStatus(const TargetStatusConstPtr& message) {
  if (message->commander != ros::this_node::getName()) return;
  const basics::MutexLock lock(mutex_);
  const char* const topic =
      held_.goal() == CockpitGoal::kTip ? names::kTipTarget : names::kPressureTarget;
  if (message->topic != topic) return;
  const bool reached = message->outcome == TargetStatus::REACHED;
  held_.noteAnswer(now(), message->outcome == TargetStatus::DROPPED, message->fault,
                   reached ? "reached" : shownText(message->message));
  if (message->outcome == TargetStatus::UNREACHABLE) held_.noteShort();
}

void CockpitLink::onMeasured(const ArmShapeConstPtr& message) {
  const basics::MutexLock lock(mutex_);
  measured_tip_.set(tipPositionOf(*message));
}

void CockpitLink::onModel(const ArmShapeConstPtr& message) {
  const basics::MutexLock lock(mutex_);
  model_tip_.set(tipPositionOf(*message));
  base_frame_ = shownText(message->header.frame_id);
  if (!std::isfinite(arm_length_)) arm_length_ = lengthOf(*message);
}

void CockpitLink::onError(const ModelErrorConstPtr& message) {
  const basics::MutexLock lock(mutex_);
  tip_error_.set(message->tip_error);
}

void CockpitLink::onLoop(const LoopStatusConstPtr& message) {
  CockpitLoop loop;
  loop.state = shownText(message->state);
  loop.message = shownText(message->message);
  if (message->has_wanted) loop.error = message->error;
  if (message->has_predicted) loop.predicted_sd = message->predicted_sd;
  const basics::MutexLock lock(mutex_);
  loop_.set(std::move(loop));
}

void CockpitLink::onBudget(const ErrorBudgetConstPtr& message) {
  const basics::MutexLock lock(mutex_);
  budget_sd_.set(message->predicted_sd);
}

void CockpitLink::onDiagnostics(const diagnostic_msgs::DiagnosticArrayConstPtr& message) {
  const std::string node = node_.resolveName(names::kPressureCommandNode);
  const std::string start = statusName(node, names::kChannelStatus);
  const std::string safety = statusName(node, names::kSafetyStatus);
  const basics::MutexLock lock(mutex_);
  for (const auto& status : message->status) {
    if (status.name == safety) target_timeout_ = numberOf(status, names::kTargetTimeoutKey);
    if (status.name.compare(0, start.size(), start) != 0) continue;
    const std::string name = status.name.substr(start.size());
    const bool known = limits_.count(name) > 0 || limits_.size() < kMostChannels;
    if (known) {
      limits_[name] = {pascalsOf(status, names::kLowerLimitKey),
                       pascalsOf(status, names::kUpperLimitKey)};
    }
  }
}

}  // namespace helix_arm::ros_bridge
