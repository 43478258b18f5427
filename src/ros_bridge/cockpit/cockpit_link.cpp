#include "cockpit_link.hpp"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <exception>
#include <system_error>
#include <thread>

#include <ros/names.h>
#include <ros/param.h>
#include <ros/service.h>
#include <ros/this_node.h>
#include <std_srvs/SetBool.h>
#include <std_srvs/Trigger.h>

#include "basics/text.hpp"
#include "helix_arm/Payload.h"
#include "helix_arm/Reload.h"
#include "helix_arm/Save.h"
#include "helix_arm/TipTarget.h"
#include "procedures/calibration_job.hpp"
#include "ros_bridge/common/client_watch.hpp"
#include "ros_bridge/common/conversions.hpp"
#include "ros_bridge/common/guarded_callbacks.hpp"
#include "ros_bridge/common/parameters.hpp"

namespace helix_arm::ros_bridge {
namespace {

CallAnswer noAnswer(const std::string& what, const std::string& why) {
  return {what, false, why, false};
}

// For the name of a file: digits and T, Z alone.
std::string timeStamp() {
  std::string out = procedures::utcNow();
  out.erase(
      std::remove_if(out.begin(), out.end(), [](unsigned char c) { return std::isalnum(c) == 0; }),
      out.end());
  return out;
}

constexpr double kLoopFresh = 2.0;     // [s]
constexpr double kTargetPeriod = 0.1;  // of the targets [s]
constexpr double kCallLimit = 3.0;     // [s]
constexpr double kUseLimit = 60.0;     // loading scenes of loaded arms takes long [s]
constexpr std::uint32_t kQueue = 100;  // of each topic

double pressureOf(const PressureArray& array, const std::string& name) {
  const auto found = std::find(array.name.begin(), array.name.end(), name);
  return found == array.name.end()
             ? kUnknown
             : array.pressure[static_cast<std::size_t>(found - array.name.begin())];
}

// Names of calls that are not asked again while they wait.
constexpr double kPayloadLimit = 30.0;  // 26 forces of a loaded arm [s]
constexpr char kReleaseCall[] = "Release", kUseCall[] = "Use it", kPayloadCall[] = "Payload";

template <class Service>
CallAnswer called(const std::string& name, Service service) {
  if (!ros::service::call(name, service)) {
    return noAnswer("", name + " is not there or does not answer");
  }
  return {"", service.response.success != 0, shownText(service.response.message)};
}

/// Writes the last calibration of an arm's calibration node into its ~out_folder, under a name that
/// holds the time, and loads it in visual_servo, which may refuse, pressure_command, vision and
/// calibration, those that are up. Blocks.
///
/// @param ns  resolved namespace of the arm's nodes.
CallAnswer useLastCalibration(const std::string& ns) {
  const std::string node = ros::names::append(ns, names::kCalibrationNode);
  std::string folder;
  ros::param::get(ros::names::append(node, "out_folder"), folder);
  if (folder.empty()) ros::param::get(ros::names::append(node, "data_folder"), folder);
  if (folder.empty()) folder = defaultFolder();
  Save save;
  save.request.path = folder + "/calibrated_" + timeStamp() + ".yaml";
  CallAnswer saved = called(ros::names::append(node, names::kSave), save);
  if (saved.answered && !saved.success) saved.message = "not written: " + saved.message;
  if (!saved.success) return saved;
  std::string users;
  for (const char* user : {names::kVisualServoNode, names::kPressureCommandNode, names::kVisionNode,
                           names::kCalibrationNode, names::kExperimentNode}) {
    const std::string name = ros::names::append(ros::names::append(ns, user), names::kReload);
    if (!ros::service::exists(name, false)) continue;
    Reload reload;
    reload.request.scene = save.request.path;
    const CallAnswer loaded = called(name, reload);
    if (!loaded.success) {
      return {"", false,
              save.request.path + (users.empty() ? "" : " is used by " + users + ", but") +
                  " is not loaded by " + user + ": " +
                  (loaded.answered ? loaded.message : "no answer")};
    }
    users += (users.empty() ? "" : ", ") + std::string(user);
  }
  return {"", !users.empty(),
          save.request.path + (users.empty() ? " is written, but no node is up that loads it"
                                             : " is used by " + users)};
}

// The least and the largest of the forces in all directions.
CallAnswer payloadAt(const std::string& name, const std::array<double, 3>& position) {
  Payload payload;
  payload.request.position.assign(position.begin(), position.end());
  if (!ros::service::call(name, payload)) {
    return noAnswer("", name + " is not there or does not answer");
  }
  const Payload::Response& found = payload.response;
  if (found.success == 0) return {"", false, shownText(found.message)};
  if (found.force.empty() || found.force.size() * 3 != found.direction.size()) {
    return {"", false, "the answer has no force, or no direction of one"};
  }
  if (!found.reached) return {"", false, "the tip does not get there even without a force"};
  const auto [least, most] = std::minmax_element(found.force.begin(), found.force.end());
  const auto words = [&](auto force) {
    const double* const d = found.direction.data() + 3 * (force - found.force.begin());
    return basics::format("%.3g N along (%.1f, %.1f, %.1f)", *force, d[0], d[1], d[2]);
  };
  return {"", true, "from " + words(least) + " to " + words(most) + " of the base"};
}

constexpr std::size_t kMostChannels = 64;

bool isWhole(const PressureArray& array) {
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

constexpr std::chrono::milliseconds kAskAgain(500);  // a master that did not answer

// Runs a body in a thread of its own, where what it holds ends, too.
template <class Body>
void elsewhere(Body body) {
  try {
    std::thread(std::move(body)).detach();
  } catch (const std::system_error&) {
    // There is no thread for it: what it holds ends here.
  }
}

}  // namespace

void ServiceCaller::ask(const std::string& what, double limit, Call call,
                        const std::string& remedy) {
  look();
  const auto count = [&](bool given_up_too) {
    return std::count_if(calls_.begin(), calls_.end(), [&](const Running& one) {
      return one.what == what && (given_up_too || !one.given_up);
    });
  };
  if (count(false) >= kMostWaiting) {
    return tell(noAnswer(what, "earlier calls still wait for their answers; is the node alive?"),
                remedy);
  }
  if (count(true) >= kMostRunning) {
    return tell(noAnswer(what, "too many calls hang; end the node that hangs"), remedy);
  }
  std::packaged_task<CallAnswer()> task(std::move(call));
  std::future<CallAnswer> answer = task.get_future();
  try {
    // Detached: nothing ends a call to a service that neither answers nor hangs up.
    std::thread(std::move(task)).detach();
  } catch (const std::system_error& fault) {
    return tell(noAnswer(what, std::string("no thread for it: ") + fault.what()), remedy);
  }
  const ros::SteadyTime due = ros::SteadyTime::now() + ros::WallDuration(limit);
  calls_.push_back({what, remedy, limit, due, std::move(answer)});
}

void ServiceCaller::look() {
  for (auto it = calls_.begin(); it != calls_.end();) {
    const bool ended = isReady(it->answer);
    const bool late = !ended && ros::SteadyTime::now() > it->due;
    if ((ended || late) && !std::exchange(it->given_up, true)) {
      CallAnswer answer = noAnswer(
          it->what, basics::format("no answer within %g s; is the node alive?", it->limit));
      try {
        if (ended) answer = it->answer.get();
      } catch (const std::exception& fault) {
        answer.message = fault.what();
      }
      answer.what = it->what;
      tell(std::move(answer), it->remedy);
    }
    it = ended ? calls_.erase(it) : std::next(it);
  }
}

template <class Action, class Run>
void ActionRuns<Action, Run>::start(const Goal& goal) {
  if (!client_.isServerConnected()) return;
  basics::MutexLock start(mutex_);
  if (run_.running) return;
  run_ = {};
  run_.running = true;
  seen_ = ros::SteadyTime::now().toSec();
  const std::uint64_t run = ++runs_;
  start.unlock();
  client_.sendGoal(
      goal,
      [this, run](const actionlib::SimpleClientGoalState& state,
                  const boost::shared_ptr<const Result>& result) {
        const basics::MutexLock lock(mutex_);
        if (!isUnderWay(run)) return;
        run_.running = false;
        run_.ended = true;
        run_.cancelled = state == actionlib::SimpleClientGoalState::PREEMPTED;
        run_.result.message = "the " + what_ + " node ended (" + state.toString() + ")";
        if (result != nullptr) run_.result = *result;
      },
      typename Client::SimpleActiveCallback(),
      [this, run](const boost::shared_ptr<const Feedback>& feedback) {
        const basics::MutexLock lock(mutex_);
        if (isUnderWay(run)) run_.progress = *feedback;
      });
}

template <class Action, class Run>
Run ActionRuns<Action, Run>::view(double now) {
  const bool there = client_.isServerConnected();
  const basics::MutexLock lock(mutex_);
  run_.there = there;
  if (there) seen_ = now;
  // A client of an action is not told that its server died.
  if (run_.running && now - seen_ >= kPatience) {
    run_.running = false;
    run_.ended = true;
    run_.result.message = "the " + what_ + " node is gone; start it, then click Start again";
  }
  return run_;
}

template <class Message>
void CockpitLink::hear(const char* topic, Heard<Message> CockpitLink::*heard,
                       bool (CockpitLink::*counts)(const Message&)) {
  subscribers_.push_back(listen<Message>(
      node_, topic, kQueue, [this, heard, counts](const ros::MessageEvent<const Message>& event) {
        const Message& message = *event.getConstMessage();
        const basics::MutexLock lock(mutex_);
        const bool is_sound = counts == nullptr || (this->*counts)(message);
        if (is_sound && heard != nullptr) this->*heard = {message, now()};
      }));
}

CockpitLink::CockpitLink(const std::string& ns) : node_(ns), spinner_(1, &queue_) {
  seen_.ns = resolved(ns);
  node_.setCallbackQueue(&queue_);
  pressure_publisher_ = node_.advertise<PressureArray>(names::kPressureTarget, 10);
  tip_publisher_ = node_.advertise<TipTarget>(names::kTipTarget, 10);
  using Self = CockpitLink;
  hear(names::kPressureCommand, &Self::command_, &Self::onCommand);
  hear(names::kPressureMeasured, &Self::reading_, &Self::onReading);
  hear(names::kSafetyState, &Self::safety_, &Self::onSafety);
  hear<TargetStatus>(names::kTargetStatus, nullptr, &Self::onStatus);
  hear(names::kMeasured, &Self::measured_);
  hear(names::kModel, &Self::model_);
  hear(names::kModelError, &Self::error_);
  hear(names::kVisualServoStatus, &Self::loop_);
  hear(names::kErrorBudget, &Self::budget_);
  hear<diagnostic_msgs::DiagnosticArray>(names::kDiagnostics, nullptr, &Self::onDiagnostics);
  const auto make = [this](auto& runs, const char* of, const char* action) {
    using Runs = typename std::decay_t<decltype(runs)>::element_type;
    runs = std::make_unique<Runs>(node_, std::string(of) + "/" + action, of);
  };
  make(calibration_, names::kCalibrationNode, names::kRunCalibration);
  make(experiment_, names::kExperimentNode, names::kRunExperiment);
  timer_ = repeat(node_, "the cockpit's targets", kTargetPeriod, [this] {
    const basics::MutexLock lock(mutex_);
    if (held_.turn(now())) send();
  });
  spinner_.start();
}

CockpitView CockpitLink::view() {
  CockpitCalibration calibration = calibration_->view(now());
  const CockpitExperiment experiment = experiment_->view(now());
  const bool tip_heard = tip_publisher_.getNumSubscribers() > 0;
  calibration.is_loaded = caller_.waits(kUseCall);
  const basics::MutexLock lock(mutex_);
  held_.look(now());
  CockpitView out = seen_;
  out.connected = command_.isFresh();
  out.tip_heard = tip_heard;
  if (!safety_.last.state.empty()) {
    SafetyState& safety = out.safety.emplace(safety_.last);
    for (std::string* const text : {&safety.state, &safety.cause, &safety.problem, &safety.action,
                                    &safety.remedy, &safety.reason}) {
      *text = shownText(*text);
    }
  }
  out.channels = channels();
  out.base_frame = shownText(model_.last.header.frame_id);
  out.arm_length = lengthOf(model_.last);
  if (measured_.isFresh()) out.measured_tip = tipPositionOf(measured_.last);
  if (model_.isFresh()) out.model_tip = tipPositionOf(model_.last);
  if (error_.isFresh()) out.tip_error = error_.last.tip_error;
  if (loop_.isFresh(kLoopFresh)) {
    out.loop = CockpitLoop{shownText(loop_.last.state), shownText(loop_.last.message)};
    if (loop_.last.has_wanted) out.loop->error = loop_.last.error;
    if (loop_.last.has_predicted) out.loop->predicted_sd = loop_.last.predicted_sd;
    if (budget_.isFresh(kLoopFresh)) out.loop->budget_sd = budget_.last.predicted_sd;
  }
  static_cast<CockpitHold&>(out) = held_.state();
  out.calibration = std::move(calibration);
  out.experiment = experiment;
  return out;
}

std::vector<CockpitChannel> CockpitLink::channels() const {
  std::vector<CockpitChannel> out;
  for (const std::string& name : command_.last.name) {
    CockpitChannel& channel = out.emplace_back();
    channel.name = shownText(name);
    if (command_.isFresh()) channel.command = pressureOf(command_.last, name);
    if (reading_.isFresh()) channel.measured = pressureOf(reading_.last, name);
    const auto limits = limits_.find(name);
    if (limits == limits_.end()) continue;
    channel.lower = limits->second[0];
    channel.upper = limits->second[1];
  }
  return out;
}

ServiceCaller::Call CockpitLink::triggers(const char* service) const {
  return [name = serviceOf(service)] { return called(name, std_srvs::Trigger()); };
}

ServiceCaller::Call CockpitLink::stops(bool engage) const {
  std_srvs::SetBool stop;
  stop.request.data = engage;
  return [name = serviceOf(names::kEmergencyStop), stop] { return called(name, stop); };
}

void CockpitLink::askUnlessOvertaken(const char* what, std::atomic<std::uint64_t> Asked::*later,
                                     const ServiceCaller::Call& call,
                                     const ServiceCaller::Call& undo) {
  if (caller_.waits(what)) return;
  const auto overtaken = [asked = asked_, later, before = ((*asked_).*later).load()] {
    return (*asked).*later != before;
  };
  caller_.ask(what, kCallLimit, [overtaken, call, undo] {
    const std::string since = ", since a stop or vent was clicked after it";
    if (overtaken()) return noAnswer("", "not sent" + since);
    CallAnswer out = call();
    // Without an answer it may have arrived, too.
    if (!overtaken() || (out.answered && !out.success)) return out;
    return noAnswer("", "undone" + since + ": " + undo().message);
  });
}

void CockpitLink::vent() {
  ++asked_->vents;
  caller_.ask("Vent", kCallLimit, triggers(names::kVent));
  const basics::MutexLock lock(mutex_);
  held_.end("the arm was vented");
}

void CockpitLink::emergencyStop(bool engage) {
  if (!engage) return askUnlessOvertaken(kReleaseCall, &Asked::stops, stops(false), stops(true));
  ++asked_->stops;
  ++asked_->vents;
  caller_.ask("Emergency stop", kCallLimit, stops(true), kStopByHand);
  const basics::MutexLock lock(mutex_);
  held_.end("the emergency stop was engaged");
}

void CockpitLink::hold(bool on) {
  basics::MutexLock lock(mutex_);
  if (held_.holds() == on || (on && !command_.isFresh())) return;
  if (on) {
    held_.holdPressures(now(), command_.last.pressure);
    return send();
  }
  held_.end("let go: the arm ramps down to rest");
  lock.unlock();
  caller_.ask("Let go", kCallLimit, triggers(names::kRest));
}

void CockpitLink::setPressure(std::size_t channel, double pressure) {
  const basics::MutexLock lock(mutex_);
  const CockpitHold& held = held_.state();
  std::vector<double> goal =
      held.goal == CockpitGoal::kPressures ? held.held : command_.last.pressure;
  if (channel >= goal.size() || !std::isfinite(pressure)) return;
  goal[channel] = pressure;
  held_.holdPressures(now(), std::move(goal));
  send();
}

void CockpitLink::send() {
  const CockpitHold& held = held_.state();
  if (held.goal == CockpitGoal::kPressures) {
    PressureArray target;
    target.header.stamp = ros::Time::now();
    target.name = command_.last.name;
    target.pressure = held.held;
    pressure_publisher_.publish(target);
  } else if (held.goal == CockpitGoal::kTip) {
    TipTarget target;
    target.header.stamp = ros::Time::now();
    target.mode = TipTarget::POSITION;
    target.pose.position = toPointMsg(Eigen::Vector3d(held.tip.data()));
    target.pose.orientation.w = 1.0;
    tip_publisher_.publish(target);
  }
}

void CockpitLink::startCalibration(const std::vector<std::string>& fit) {
  RunCalibrationGoal goal;
  goal.walk = fit == std::vector<std::string>{kWalk};
  if (!goal.walk) goal.fit = fit;
  goal.loop = std::find(fit.begin(), fit.end(), "response") != fit.end();
  calibration_->start(goal);
}

void CockpitLink::startExperiment(const std::string& name) {
  RunExperimentGoal goal;
  goal.name = name;
  experiment_->start(goal);
}

void CockpitLink::askPayload(const std::array<double, 3>& position) {
  if (caller_.waits(kPayloadCall)) return;
  caller_.ask(kPayloadCall, kPayloadLimit,
              [name = serviceOf(names::kPayload), position] { return payloadAt(name, position); });
}

void CockpitLink::useCalibration() {
  if (caller_.waits(kUseCall)) return;
  caller_.ask(kUseCall, kUseLimit, [ns = node_.getNamespace()] { return useLastCalibration(ns); });
}

bool CockpitLink::onCommand(const PressureArray& message) {
  if (!isWhole(message)) return false;
  if (message.name != command_.last.name) held_.end("the arm has other actuators now");
  return true;
}

bool CockpitLink::onReading(const PressureArray& message) { return isWhole(message); }

bool CockpitLink::onSafety(const SafetyState& message) {
  held_.noteState(message.state == SafetyState::ENABLED, shownText(message.reason));
  return true;
}

bool CockpitLink::onStatus(const TargetStatus& message) {
  const char* const topic =
      held_.state().goal == CockpitGoal::kTip ? names::kTipTarget : names::kPressureTarget;
  if (message.commander != ros::this_node::getName() || message.topic != topic) return false;
  const bool reached = message.outcome == TargetStatus::REACHED;
  held_.noteAnswer(now(), message.outcome == TargetStatus::DROPPED, message.fault,
                   reached ? "reached" : shownText(message.message),
                   message.outcome == TargetStatus::UNREACHABLE);
  return true;
}

bool CockpitLink::onDiagnostics(const diagnostic_msgs::DiagnosticArray& message) {
  const std::string node = node_.resolveName(names::kPressureCommandNode);
  const std::string start = statusName(node, names::kChannelStatus);
  const std::string safety = statusName(node, names::kSafetyStatus);
  for (const auto& status : message.status) {
    if (status.name == safety) seen_.target_timeout = numberOf(status, names::kTargetTimeoutKey);
    if (status.name.compare(0, start.size(), start) != 0) continue;
    const std::string name = status.name.substr(start.size());
    if (limits_.count(name) == 0 && limits_.size() >= kMostChannels) continue;
    limits_[name] = {1e3 * numberOf(status, names::kLowerLimitKey),
                     1e3 * numberOf(status, names::kUpperLimitKey)};
  }
  return true;
}

void LinkBuilder::begin(const std::string& ns) {
  const auto next = std::make_shared<Attempt>();
  next->ns = CockpitLink::resolved(ns);
  std::packaged_task<std::unique_ptr<CockpitLink>()> task([next]() -> std::unique_ptr<CockpitLink> {
    while (!masterAnswers()) {
      next->silent = true;
      std::this_thread::sleep_for(kAskAgain);
      if (next->cancelled) return nullptr;
    }
    next->silent = false;
    return next->cancelled ? nullptr : std::make_unique<CockpitLink>(next->ns);
  });
  auto made = task.get_future();
  cancel();
  std::thread(std::move(task)).detach();
  attempt_ = next;
  made_ = std::move(made);
}

void LinkBuilder::cancel() {
  if (attempt_) attempt_->cancelled = true;
  attempt_.reset();
  if (made_.valid()) elsewhere([made = std::move(made_)] { made.wait(); });
}

void LinkBuilder::end(std::unique_ptr<CockpitLink> link) {
  if (link) elsewhere([link = std::move(link)] {});
}

}  // namespace helix_arm::ros_bridge
