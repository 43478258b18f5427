#include "helix_arm/ros_bridge/cockpit/cockpit_link.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <utility>

#include <ros/service.h>
#include <ros/this_node.h>
#include <std_srvs/SetBool.h>
#include <std_srvs/Trigger.h>

#include "helix_arm/TipTarget.h"
#include "helix_arm/basics/quote.hpp"
#include "helix_arm/ros_bridge/cockpit/calibration_use.hpp"
#include "helix_arm/ros_bridge/cockpit/cockpit_words.hpp"
#include "helix_arm/ros_bridge/common/diagnostics.hpp"
#include "helix_arm/ros_bridge/common/goal_serializers.hpp"
#include "helix_arm/ros_bridge/common/guarded_callbacks.hpp"
#include "helix_arm/ros_bridge/common/names.hpp"

namespace helix_arm::ros_bridge {
namespace {

constexpr double kFresh = 1.0;      // older values are unknown [s]
constexpr double kLoopFresh = 2.0;  // [s]
constexpr double kPeriod = 0.1;     // of the targets [s]
constexpr double kCallLimit = 3.0;  // [s]
constexpr double kUseLimit = 60.0;  // loading scenes of loaded arms takes long [s]
constexpr std::size_t kMostActuators = 64, kMostWarnings = 8;

double steadyNow() { return ros::SteadyTime::now().toSec(); }

bool isSound(const PressureArray& array) {
  return !array.name.empty() && array.name.size() == array.pressure.size() &&
         array.name.size() <= kMostActuators;
}

double pressureOf(const PressureArray& array, const std::string& name) {
  const auto found = std::find(array.name.begin(), array.name.end(), name);
  return found == array.name.end()
             ? kUnknown
             : array.pressure[static_cast<std::size_t>(found - array.name.begin())];
}

std::vector<double> positionOf(const ArmShape& shape) {
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

double valueOf(const diagnostic_msgs::DiagnosticStatus& status, const char* key) {
  for (const auto& entry : status.values) {
    if (entry.key == key) return std::strtod(entry.value.c_str(), nullptr);
  }
  return kUnknown;
}

// The value of a key in kPa, in Pa.
double pascalsOf(const diagnostic_msgs::DiagnosticStatus& status, const char* key) {
  return 1e3 * valueOf(status, key);
}

}  // namespace

template <class T>
void CockpitLink::Dated<T>::set(T next) {
  value = std::move(next);
  time = steadyNow();
}

template <class T>
bool CockpitLink::Dated<T>::isFresh(double longest) const {
  return steadyNow() - time < longest;
}

CockpitLink::CockpitLink(const std::string& ns, CallDesk::Done done)
    : desk_(std::move(done)), node_(ns), spinner_(1, &queue_) {
  node_.setCallbackQueue(&queue_);
  pressure_publisher_ = node_.advertise<PressureArray>(names::kPressureTarget, 10);
  tip_publisher_ = node_.advertise<TipTarget>(names::kTipTarget, 10);
  using Link = CockpitLink;
  subscribers_ = {listen(node_, names::kPressureCommand, 10, &Link::onCommand, this),
                  listen(node_, names::kPressureMeasured, 10, &Link::onPressures, this),
                  listen(node_, names::kSafetyState, 10, &Link::onSafety, this),
                  listen(node_, names::kTargetStatus, 100, &Link::onStatus, this),
                  listen(node_, names::kMeasured, 10, &Link::onMeasured, this),
                  listen(node_, names::kModel, 10, &Link::onModel, this),
                  listen(node_, names::kModelError, 10, &Link::onError, this),
                  listen(node_, names::kSightLoopStatus, 10, &Link::onLoop, this),
                  listen(node_, names::kErrorBudget, 10, &Link::onBudget, this),
                  listen(node_, names::kDiagnostics, 10, &Link::onDiagnostics, this)};
  client_ = std::make_unique<Client>(
      node_, std::string(names::kCalibrationNode) + "/" + names::kRunCalibration, false);
  timer_ = repeat(node_, "the cockpit's targets", kPeriod, &Link::onTurn, this);
  spinner_.start();
}

CockpitLink::~CockpitLink() {
  spinner_.stop();
  timer_.stop();
  client_.reset();
  subscribers_.clear();
}

std::string CockpitLink::serviceOf(const std::string& node, const std::string& name) const {
  return node_.resolveName(node + "/" + name);
}

CockpitView CockpitLink::view() {
  const bool there = client_->isServerConnected();
  const basics::MutexLock lock(mutex_);
  held_.look(steadyNow());
  CockpitView out;
  out.ns = node_.getNamespace();
  out.base_frame = base_frame_;
  out.arm_length = arm_length_;
  out.connected = command_.isFresh(kFresh);
  if (!safety_.value.state.empty()) out.safety = safety_.value;
  out.channels = channels();
  if (measured_tip_.isFresh(kFresh)) out.measured_tip = measured_tip_.value;
  if (model_tip_.isFresh(kFresh)) out.model_tip = model_tip_.value;
  if (tip_error_.isFresh(kFresh)) out.tip_error = tip_error_.value;
  if (loop_.isFresh(kLoopFresh)) {
    out.loop = loop_.value;
    if (budget_sd_.isFresh(kLoopFresh)) out.loop->budget_sd = budget_sd_.value;
  }
  out.goal = held_.goal();
  out.held = held_.pressures();
  out.answer = held_.answer();
  out.refused = held_.refused();
  out.short_of = held_.shortOf();
  out.target_timeout = target_timeout_;
  out.calibration = calibration_;
  out.calibration.there = there;
  return out;
}

std::vector<CockpitChannel> CockpitLink::channels() const {
  const bool commanded = command_.isFresh(kFresh), measured = pressures_.isFresh(kFresh);
  std::vector<CockpitChannel> out;
  for (const std::string& name : command_.value.name) {
    CockpitChannel channel;
    channel.name = shownText(name);
    if (commanded) channel.command = pressureOf(command_.value, name);
    if (measured) channel.measured = pressureOf(pressures_.value, name);
    const auto limits = limits_.find(name);
    if (limits != limits_.end()) {
      channel.lower = limits->second[0];
      channel.upper = limits->second[1];
    }
    out.push_back(std::move(channel));
  }
  return out;
}

void CockpitLink::trigger(const std::string& what, const std::string& service) {
  desk_.ask(what, kCallLimit, [what, name = serviceOf(names::kPressureCommandNode, service)] {
    std_srvs::Trigger call;
    if (!ros::service::call(name, call)) {
      return CallAnswer{what, false, name + " is not there or does not answer"};
    }
    return CallAnswer{what, call.response.success != 0, shownText(call.response.message)};
  });
}

void CockpitLink::enable() { trigger("Enable", names::kEnable); }

void CockpitLink::vent() {
  trigger("Vent", names::kVent);
  const basics::MutexLock lock(mutex_);
  if (held_.goal() != CockpitGoal::kNone) held_.end("the arm was vented");
}

void CockpitLink::emergencyStop(bool engage) {
  const std::string what = engage ? "Emergency stop" : "Release";
  const std::string name = serviceOf(names::kPressureCommandNode, names::kEmergencyStop);
  desk_.ask(what, kCallLimit, [what, engage, name] {
    std_srvs::SetBool call;
    call.request.data = engage;
    if (!ros::service::call(name, call)) {
      return CallAnswer{what, false,
                        name + " is not there or does not answer" +
                            (engage ? ": shut the supply and open the relief valve by hand" : "")};
    }
    return CallAnswer{what, call.response.success != 0, shownText(call.response.message)};
  });
  const basics::MutexLock lock(mutex_);
  if (held_.goal() != CockpitGoal::kNone) held_.end("the emergency stop was engaged");
}

void CockpitLink::hold(bool on) {
  {
    const basics::MutexLock lock(mutex_);
    if (on) {
      if (held_.goal() != CockpitGoal::kNone || !command_.isFresh(kFresh)) return;
      held_.holdPressures(steadyNow(), command_.value.pressure);
      send();
      return;
    }
    if (held_.goal() == CockpitGoal::kNone) return;
    held_.end("let go: the arm ramps down to rest");
  }
  trigger("Let go", names::kRest);
}

void CockpitLink::setPressure(std::size_t channel, double pressure) {
  const basics::MutexLock lock(mutex_);
  std::vector<double> goal =
      held_.goal() == CockpitGoal::kPressures ? held_.pressures() : command_.value.pressure;
  if (channel >= goal.size() || !std::isfinite(pressure)) return;
  goal[channel] = pressure;
  held_.holdPressures(steadyNow(), std::move(goal));
  send();
}

void CockpitLink::aimTip(const std::array<double, 3>& position) {
  const basics::MutexLock lock(mutex_);
  held_.holdTip(steadyNow(), position);
  send();
}

void CockpitLink::send() {
  if (held_.goal() == CockpitGoal::kPressures) {
    PressureArray target;
    target.header.stamp = ros::Time::now();
    target.name = command_.value.name;
    target.pressure = held_.pressures();
    pressure_publisher_.publish(target);
  } else if (held_.goal() == CockpitGoal::kTip) {
    TipTarget target;
    target.header.stamp = ros::Time::now();
    target.mode = TipTarget::POSITION;
    target.pose.position.x = held_.tip()[0];
    target.pose.position.y = held_.tip()[1];
    target.pose.position.z = held_.tip()[2];
    target.pose.orientation.w = 1.0;
    tip_publisher_.publish(target);
  }
}

void CockpitLink::startCalibration(const std::vector<std::string>& fit) {
  if (!client_->isServerConnected()) return;
  {
    const basics::MutexLock lock(mutex_);
    if (calibration_.running) return;
    calibration_ = {};
    calibration_.running = true;
  }
  RunCalibrationGoal goal;
  goal.fit = fit;
  goal.loop = std::find(fit.begin(), fit.end(), "response") != fit.end();
  client_->sendGoal(
      goal,
      [this](const actionlib::SimpleClientGoalState& state,
             const RunCalibrationResultConstPtr& result) { onResult(result.get(), state); },
      Client::SimpleActiveCallback(),
      [this](const RunCalibrationFeedbackConstPtr& feedback) { onFeedback(*feedback); });
}

void CockpitLink::cancelCalibration() { client_->cancelGoal(); }

void CockpitLink::useCalibration() {
  desk_.ask("Use it", kUseLimit, [ns = node_.getNamespace()] { return useLastCalibration(ns); });
}

void CockpitLink::onFeedback(const RunCalibrationFeedback& feedback) {
  const basics::MutexLock lock(mutex_);
  calibration_.step = feedback.step;
  calibration_.steps = feedback.steps;
  calibration_.samples = feedback.samples;
  calibration_.state = shownText(feedback.state);
}

void CockpitLink::onResult(const RunCalibrationResult* result,
                           const actionlib::SimpleClientGoalState& ending) {
  const basics::MutexLock lock(mutex_);
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
  safety.reason = shownText(message->reason);
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
  held_.noteAnswer(steadyNow(), message->outcome == TargetStatus::DROPPED, message->fault,
                   reached ? "reached" : shownText(message->message));
  if (message->outcome == TargetStatus::UNREACHABLE) held_.noteShort();
}

void CockpitLink::onMeasured(const ArmShapeConstPtr& message) {
  const basics::MutexLock lock(mutex_);
  measured_tip_.set(positionOf(*message));
}

void CockpitLink::onModel(const ArmShapeConstPtr& message) {
  const basics::MutexLock lock(mutex_);
  model_tip_.set(positionOf(*message));
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
    if (status.name == safety) target_timeout_ = valueOf(status, names::kTargetTimeoutKey);
    if (status.name.compare(0, start.size(), start) != 0) continue;
    const std::string name = status.name.substr(start.size());
    const bool known = limits_.count(name) > 0 || limits_.size() < kMostActuators;
    if (known) {
      limits_[name] = {pascalsOf(status, names::kLowerLimitKey),
                       pascalsOf(status, names::kUpperLimitKey)};
    }
  }
}

void CockpitLink::onTurn(const ros::SteadyTimerEvent&) {
  const basics::MutexLock lock(mutex_);
  if (held_.turn(steadyNow())) send();
}

}  // namespace helix_arm::ros_bridge
