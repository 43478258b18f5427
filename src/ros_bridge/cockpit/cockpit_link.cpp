#include "ros_bridge/cockpit/cockpit_link.hpp"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <utility>

#include <ros/service.h>
#include <std_srvs/SetBool.h>
#include <std_srvs/Trigger.h>

#include "helix_arm/TipTarget.h"
#include "ros_bridge/cockpit/calibration_use.hpp"
#include "ros_bridge/cockpit/cockpit_words.hpp"
#include "ros_bridge/common/goal_serializers.hpp"
#include "ros_bridge/common/guarded_callbacks.hpp"
#include "ros_bridge/common/names.hpp"

namespace helix_arm::ros_bridge {
namespace {

constexpr double kValueFresh = 1.0;    // older values are unknown [s]
constexpr double kLoopFresh = 2.0;     // [s]
constexpr double kTargetPeriod = 0.1;  // of the targets [s]
constexpr double kCallLimit = 3.0;     // [s]
constexpr double kUseLimit = 60.0;     // loading scenes of loaded arms takes long [s]

double pressureOf(const PressureArray& array, const std::string& name) {
  const auto found = std::find(array.name.begin(), array.name.end(), name);
  return found == array.name.end()
             ? kUnknown
             : array.pressure[static_cast<std::size_t>(found - array.name.begin())];
}

// Names of the calls that are not asked again while they wait.
constexpr char kEnableCall[] = "Enable", kReleaseCall[] = "Release", kUseCall[] = "Use it";

CallAnswer triggered(const std::string& what, const std::string& name) {
  std_srvs::Trigger call;
  if (!ros::service::call(name, call)) {
    return {what, false, name + " is not there or does not answer", false};
  }
  return {what, call.response.success != 0, shownText(call.response.message)};
}

CallAnswer stopped(const std::string& what, const std::string& name, bool engage) {
  std_srvs::SetBool stop;
  stop.request.data = engage;
  if (!ros::service::call(name, stop)) return {what, false, "no answer of " + name, false};
  return {what, stop.response.success != 0, shownText(stop.response.message)};
}

// A call that a later wish of the user takes back: not sent, if there is still time, or undone.
template <class Overtaken, class Call, class Undo>
CallAnswer unlessOvertaken(const std::string& what, const Overtaken& overtaken, const Call& call,
                           const Undo& undo) {
  if (overtaken())
    return {what, false, "not sent, since a stop or vent was clicked after it", false};
  CallAnswer out = call();
  // Without an answer it may have arrived, too.
  if (!overtaken() || (out.answered && !out.success)) return out;
  const CallAnswer undone = undo();
  return {what, false, "undone, since a stop or vent was clicked after it: " + undone.message,
          false};
}

}  // namespace

CockpitLink::CockpitLink(const std::string& ns)
    : desk_([this](const CallAnswer& answer) { note(answer); }),
      ns_(resolved(ns)),
      node_(ns),
      spinner_(1, &queue_) {
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
                  listen(node_, names::kVisualServoStatus, 10, &Link::onLoop, this),
                  listen(node_, names::kErrorBudget, 10, &Link::onBudget, this),
                  listen(node_, names::kDiagnostics, 10, &Link::onDiagnostics, this)};
  client_ = std::make_unique<Client>(
      node_, std::string(names::kCalibrationNode) + "/" + names::kRunCalibration, false);
  timer_ = repeat(node_, "the cockpit's targets", kTargetPeriod, &Link::onTurn, this);
  spinner_.start();
}

std::string CockpitLink::resolved(const std::string& ns) {
  const std::string out = ros::NodeHandle(ns).getNamespace();
  return out.empty() ? "/" : out;  // roscpp's root
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

void CockpitLink::note(const CallAnswer& answer) {
  const basics::MutexLock lock(answers_mutex_);
  answers_.push_back(answer);
}

std::vector<CallAnswer> CockpitLink::takeAnswers() {
  const basics::MutexLock lock(answers_mutex_);
  return std::exchange(answers_, {});
}

CockpitView CockpitLink::view() {
  const bool there = client_->isServerConnected();
  const bool tip_heard = tip_publisher_.getNumSubscribers() > 0;
  const bool is_loaded = desk_.waits(kUseCall);
  const basics::MutexLock lock(mutex_);
  held_.look(now());
  watchCalibration(there);
  CockpitView out;
  out.ns = ns_;
  out.base_frame = base_frame_;
  out.arm_length = arm_length_;
  out.connected = command_.isFresh(kValueFresh);
  out.tip_heard = tip_heard;
  if (!safety_.value.state.empty()) out.safety = safety_.value;
  out.channels = channels();
  if (measured_tip_.isFresh(kValueFresh)) out.measured_tip = measured_tip_.value;
  if (model_tip_.isFresh(kValueFresh)) out.model_tip = model_tip_.value;
  if (tip_error_.isFresh(kValueFresh)) out.tip_error = tip_error_.value;
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
  out.calibration.is_loaded = is_loaded;
  return out;
}

std::vector<CockpitChannel> CockpitLink::channels() const {
  const bool commanded = command_.isFresh(kValueFresh), measured = pressures_.isFresh(kValueFresh);
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

void CockpitLink::enable() {
  if (desk_.waits(kEnableCall)) return;
  const auto overtaken = [asked = asked_, vents = asked_->vents.load()] {
    return asked->vents != vents;
  };
  desk_.ask(kEnableCall, kCallLimit,
            [overtaken, enable = serviceOf(names::kPressureCommandNode, names::kEnable),
             vent = serviceOf(names::kPressureCommandNode, names::kVent)] {
              return unlessOvertaken(
                  kEnableCall, overtaken, [&] { return triggered(kEnableCall, enable); },
                  [&] { return triggered(kEnableCall, vent); });
            });
}

void CockpitLink::vent() {
  ++asked_->vents;
  desk_.ask("Vent", kCallLimit, [name = serviceOf(names::kPressureCommandNode, names::kVent)] {
    return triggered("Vent", name);
  });
  const basics::MutexLock lock(mutex_);
  if (held_.goal() != CockpitGoal::kNone) held_.end("the arm was vented");
}

void CockpitLink::emergencyStop(bool engage) {
  const std::string name = serviceOf(names::kPressureCommandNode, names::kEmergencyStop);
  if (engage) {
    ++asked_->stops;
    ++asked_->vents;
    const auto stop = [name] { return stopped("Emergency stop", name, true); };
    desk_.ask("Emergency stop", kCallLimit, stop, kStopByHand);
    const basics::MutexLock lock(mutex_);
    if (held_.goal() != CockpitGoal::kNone) held_.end("the emergency stop was engaged");
    return;
  }
  if (desk_.waits(kReleaseCall)) return;
  const auto overtaken = [asked = asked_, stops = asked_->stops.load()] {
    return asked->stops != stops;
  };
  desk_.ask(kReleaseCall, kCallLimit, [overtaken, name] {
    return unlessOvertaken(
        kReleaseCall, overtaken, [&] { return stopped(kReleaseCall, name, false); },
        [&] { return stopped(kReleaseCall, name, true); });
  });
}

void CockpitLink::hold(bool on) {
  {
    const basics::MutexLock lock(mutex_);
    if (on) {
      if (held_.goal() != CockpitGoal::kNone || !command_.isFresh(kValueFresh)) return;
      held_.holdPressures(now(), command_.value.pressure);
      send();
      return;
    }
    if (held_.goal() == CockpitGoal::kNone) return;
    held_.end("let go: the arm ramps down to rest");
  }
  desk_.ask("Let go", kCallLimit, [name = serviceOf(names::kPressureCommandNode, names::kRest)] {
    return triggered("Let go", name);
  });
}

void CockpitLink::setPressure(std::size_t channel, double pressure) {
  const basics::MutexLock lock(mutex_);
  std::vector<double> goal =
      held_.goal() == CockpitGoal::kPressures ? held_.pressures() : command_.value.pressure;
  if (channel >= goal.size() || !std::isfinite(pressure)) return;
  goal[channel] = pressure;
  held_.holdPressures(now(), std::move(goal));
  send();
}

void CockpitLink::aimTip(const std::array<double, 3>& position) {
  const basics::MutexLock lock(mutex_);
  held_.holdTip(now(), position);
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
  std::uint64_t run = 0;
  {
    const basics::MutexLock lock(mutex_);
    if (calibration_.running) return;
    calibration_ = {};
    calibration_.running = true;
    calibrator_seen_ = now();
    run = ++runs_;
  }
  RunCalibrationGoal goal;
  goal.fit = fit;
  goal.loop = std::find(fit.begin(), fit.end(), "response") != fit.end();
  client_->sendGoal(
      goal,
      [this, run](const actionlib::SimpleClientGoalState& state,
                  const RunCalibrationResultConstPtr& result) {
        onResult(run, result.get(), state);
      },
      Client::SimpleActiveCallback(),
      [this, run](const RunCalibrationFeedbackConstPtr& feedback) { onFeedback(run, *feedback); });
}

// A client of an action is not told that its server died.
void CockpitLink::watchCalibration(bool there) {
  if (there) calibrator_seen_ = now();
  if (!calibration_.running || now() - calibrator_seen_ < kValueFresh) return;
  calibration_.running = false;
  calibration_.ended = true;
  calibration_.message = "the calibration node is gone; start it, then click Start again";
}

void CockpitLink::cancelCalibration() { client_->cancelGoal(); }

void CockpitLink::useCalibration() {
  if (desk_.waits(kUseCall)) return;
  desk_.ask(kUseCall, kUseLimit, [ns = node_.getNamespace()] { return useLastCalibration(ns); });
}

void CockpitLink::onTurn(const ros::SteadyTimerEvent&) {
  const basics::MutexLock lock(mutex_);
  if (held_.turn(now())) send();
}

}  // namespace helix_arm::ros_bridge
