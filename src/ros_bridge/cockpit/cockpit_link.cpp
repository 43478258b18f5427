#include "cockpit_link.hpp"

#include <cmath>
#include <cstdlib>
#include <exception>
#include <system_error>

#include <ros/master.h>
#include <ros/service.h>
#include <ros/this_node.h>
#include <std_srvs/SetBool.h>
#include <std_srvs/Trigger.h>

#include "helix_arm/TipTarget.h"
#include "ros_bridge/common/client_watch.hpp"
#include "ros_bridge/common/diagnostics.hpp"
#include "ros_bridge/common/goal_serializers.hpp"
#include "ros_bridge/common/guarded_callbacks.hpp"
#include "ros_bridge/names.hpp"

namespace helix_arm::ros_bridge {

void HeldGoal::begin(double now, CockpitGoal goal) {
  if (goal_ == CockpitGoal::kNone) waits_since_.reset();
  if (goal_ != goal) answered_at_ = now;  // a slider that is dragged on is no answer
  goal_ = goal;
  last_look_ = now;
  answer_.clear();
  refused_ = short_of_ = false;
}

void HeldGoal::noteAnswer(double now, bool dropped, const std::string& fault,
                          const std::string& message) {
  if (goal_ == CockpitGoal::kNone) return;
  answered_at_ = now;
  answer_ = message;
  refused_ = dropped;
  short_of_ = false;
  if (!dropped) {
    waits_since_.reset();
  } else if (fault == "other_commander") {
    if (!waits_since_) waits_since_ = now;
  } else if (fault != "stale") {  // the next one may be in time
    end(message);
    refused_ = true;
  }
}

bool HeldGoal::turn(double now) {
  if (goal_ == CockpitGoal::kNone) return false;
  if (now - last_look_ > kBlind) {
    end("the hold ended: the window did not respond");
    return false;
  }
  if (now - answered_at_ > kUnanswered) {
    end("the hold ended: nothing answers its targets; is the node that takes them alive?");
    refused_ = true;
    return false;
  }
  if (waits_since_ && now - *waits_since_ > kPatience) {
    const std::string why = answer_;
    end("another commander keeps the arm: " + why);
    refused_ = true;
    return false;
  }
  return true;
}

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

constexpr std::chrono::milliseconds kAskAgain(500);  // a master that did not answer

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

void CockpitLink::useCalibration() {
  if (desk_.waits(kUseCall)) return;
  desk_.ask(kUseCall, kUseLimit, [ns = node_.getNamespace()] { return useLastCalibration(ns); });
}

// What CockpitLink hears.

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

void CockpitLink::onLoop(const LoopStatusConstPtr& message) {
  CockpitLoop loop;
  loop.state = shownText(message->state);
  loop.message = shownText(message->message);
  if (message->has_wanted) loop.error = message->error;
  if (message->has_predicted) loop.predicted_sd = message->predicted_sd;
  const basics::MutexLock lock(mutex_);
  loop_.set(std::move(loop));
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

// Shared with the thread, which may outlive the builder.
struct LinkBuilder::State {
  void work() HELIX_ARM_EXCLUDES(mutex) {
    basics::MutexLock lock(mutex);
    while (!wish.empty()) {
      const std::string ns = wish;
      lock.unlock();
      const bool answers = masterAnswers();
      std::unique_ptr<CockpitLink> link;
      std::exception_ptr thrown;
      try {
        if (answers) link = std::make_unique<CockpitLink>(ns);
      } catch (const std::exception&) {
        thrown = std::current_exception();
      }
      lock.lock();
      silent = !answers;
      if (silent) {
        changed.waitFor(lock, kAskAgain, [&]() HELIX_ARM_REQUIRES(mutex) { return wish != ns; });
      } else if (wish == ns) {
        made = std::move(link);
        fault = thrown;
        wish.clear();
      } else {
        lock.unlock();
        link.reset();
        lock.lock();
      }
    }
    works = false;
  }

  basics::Mutex mutex;
  basics::Condition changed;
  std::string wish HELIX_ARM_GUARDED_BY(mutex);  ///< resolved namespace; empty: none
  bool works HELIX_ARM_GUARDED_BY(mutex) = false;
  bool silent HELIX_ARM_GUARDED_BY(mutex) = false;  ///< the master did not answer
  std::unique_ptr<CockpitLink> made HELIX_ARM_GUARDED_BY(mutex);
  std::exception_ptr fault HELIX_ARM_GUARDED_BY(mutex);
};

LinkBuilder::LinkBuilder() : state_(std::make_shared<State>()) {}

void LinkBuilder::begin(const std::string& ns) {
  const std::string resolved = CockpitLink::resolved(ns);
  cancel();
  const basics::MutexLock lock(state_->mutex);
  state_->wish = resolved;
  state_->silent = false;
  if (state_->works) return;
  std::thread([state = state_] { state->work(); }).detach();
  state_->works = true;
}

void LinkBuilder::cancel() {
  std::unique_ptr<CockpitLink> unwanted;
  {
    const basics::MutexLock lock(state_->mutex);
    state_->wish.clear();
    state_->fault = nullptr;
    unwanted = std::move(state_->made);
    state_->changed.notifyAll();
  }
  end(std::move(unwanted));
}

std::unique_ptr<CockpitLink> LinkBuilder::take() {
  const basics::MutexLock lock(state_->mutex);
  if (state_->fault) std::rethrow_exception(std::exchange(state_->fault, nullptr));
  return std::move(state_->made);
}

std::string LinkBuilder::connectingTo() const {
  const basics::MutexLock lock(state_->mutex);
  return state_->wish;
}

std::string LinkBuilder::silentMaster() const {
  const basics::MutexLock lock(state_->mutex);
  return state_->silent && !state_->wish.empty() ? ros::master::getURI() : "";
}

void LinkBuilder::end(std::unique_ptr<CockpitLink> link) {
  if (!link) return;
  CockpitLink* const last = link.get();
  try {
    std::thread([last] { delete last; }).detach();
    static_cast<void>(link.release());
  } catch (const std::system_error&) {
    link.reset();  // here, since there is no thread for it
  }
}

}  // namespace helix_arm::ros_bridge
