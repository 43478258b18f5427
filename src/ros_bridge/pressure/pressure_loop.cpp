#include "pressure_loop.hpp"

#include <algorithm>
#include <limits>
#include <utility>
#include <variant>

#include "ros_bridge/common/conversions.hpp"
#include "ros_bridge/common/guarded_callbacks.hpp"
#include "ros_bridge/names.hpp"

namespace helix_arm::ros_bridge {

PressureLoop::PressureLoop(ros::NodeHandle node, const model::Arm& arm, double rate,
                           int realtime_priority, regulator::PressurePath path, bool auto_enable,
                           Gate gate, Take take)
    : period_(1.0 / rate),
      realtime_priority_(realtime_priority),
      auto_enable_(auto_enable),
      gate_(std::move(gate)),
      take_(std::move(take)),
      arm_(arm),
      path_(std::move(path)),
      command_publisher_(node.advertise<PressureArray>(names::kPressureCommand, 10)),
      safety_publisher_(node.advertise<SafetyState>(names::kSafetyState, 10, true)),
      reading_spinner_(1, &reading_queue_),
      take_guard_("a reading") {
  node.setCallbackQueue(&queue_);
  if (path_.io() != nullptr) {
    measured_publisher_ = node.advertise<PressureArray>(names::kPressureMeasured, 10);
  } else {
    ros::NodeHandle other = onQueue(node, reading_queue_);
    reading_subscriber_ =
        listen(other, names::kPressureMeasured, 10, &PressureLoop::onReading, this);
  }
  ros::NodeHandle below = onQueue(ros::NodeHandle("~"), queue_);
  enable_server_ = serve(below, names::kEnable, &PressureLoop::onEnable, this);
  rest_server_ = serve<Trigger::Request, Trigger::Response>(
      below, names::kRest, [this](auto& call) { return onRest(call); });
  vent_server_ = serve(below, names::kVent, &PressureLoop::onVent, this);
  stop_server_ = serve(below, names::kEmergencyStop, &PressureLoop::onStop, this);
  reading_spinner_.start();
  thread_.start([this] { run(); });
}

PressureLoop::~PressureLoop() {
  end();
  ros::getGlobalCallbackQueue()->removeByID(reinterpret_cast<std::uint64_t>(this));
}

std::optional<control::Refusal> PressureLoop::command(const std::string& commander,
                                                      const Eigen::VectorXd& pressure) {
  if (auto blocked = gate_(*this, pressure)) {
    const regulator::PriorityLock lock(mutex_);
    if (!path_.core().report().resting) path_.target(regulator::steadyNow(), path_.core().goal());
    return blocked;
  }
  const regulator::PriorityLock lock(mutex_);
  const double now = regulator::steadyNow();
  control::SafetyCore& core = path_.core();
  if (rested_.refuses(commander, now, core.rules().target_timeout)) {
    return control::restedRefusal(core.rules().target_timeout);
  }
  std::string refusal;
  if (auto_enable_ && core.mayEnableItself()) refusal = path_.enable(now);
  if (refusal.empty() && !path_.target(now, pressure)) refusal = path_.reason();
  if (refusal.empty()) {
    commander_ = commander;
    rested_.release();
  }
  publish(now);
  if (refusal.empty()) return std::nullopt;
  return control::Refusal{control::Fault::kNotEnabled, refusal};
}

void PressureLoop::hold() {
  const regulator::PriorityLock lock(mutex_);
  if (path_.core().report().resting) return;
  path_.target(regulator::steadyNow(), path_.core().orders().set_point);
}

void PressureLoop::adopt(const model::Arm& arm, std::vector<control::ChannelRules> channels,
                         const control::SafetyRules& rules) {
  const regulator::PriorityLock lock(mutex_);
  path_.core().adopt(std::move(channels), rules);
  arm_ = arm;
}

void PressureLoop::guardedBy(std::shared_ptr<const regulator::GuardProcess> guard) {
  const regulator::PriorityLock lock(mutex_);
  path_.guardedBy(std::move(guard));
}

bool PressureLoop::end() {
  ends_ = true;
  thread_.join();
  reading_spinner_.stop();
  const regulator::PriorityLock lock(mutex_);
  return path_.end();
}

Eigen::VectorXd PressureLoop::goal() const {
  const regulator::PriorityLock lock(mutex_);
  return arm_.clamped(path_.core().goal());  // a vented channel is at the atmosphere
}

PressureLoop::Snapshot PressureLoop::snapshot() const {
  const regulator::PriorityLock lock(mutex_);
  const control::SafetyCore& core = path_.core();
  Snapshot out{core.report(),  path_.reason(), core.orders(), core.goal(),
               core.reading(), std::nullopt,   turns_,        bad_readings_};
  if (path_.io() != nullptr) out.io = path_.io()->status();
  return out;
}

ros::NodeHandle PressureLoop::onQueue(ros::NodeHandle node, ros::CallbackQueue& queue) {
  node.setCallbackQueue(&queue);
  return node;
}

double PressureLoop::ageOf(const ros::Time& stamp) {
  if (stamp.isZero() || !ros::Time::isSystemTime()) return 0;
  return ros::Time::now().toSec() - stamp.toSec();
}

SafetyState PressureLoop::toSafetyMsg(const ros::Time& stamp, const regulator::PressurePath& path) {
  const control::SafetyCore& core = path.core();
  const control::SafetyReport& report = core.report();
  SafetyState out;
  out.header.stamp = stamp;
  out.state = nameOf(report.state);
  out.cause = nameOf(report.cause);
  const control::SafetyText text = path.text();
  out.problem = text.problem;
  out.action = text.action;
  out.remedy = text.remedy;
  out.reason = text.line(report.state);
  if (report.channel >= 0) {
    out.actuator = core.channels()[static_cast<std::size_t>(report.channel)].name;
  }
  out.value = report.value;
  out.limit = report.limit;
  out.resting = report.resting;
  out.stopped = report.stopped;
  out.vent_overdue = report.vent_overdue;
  return out;
}

LogLevel PressureLoop::levelOf(const control::SafetyReport& report) {
  using control::SafetyState;
  const bool asked_for =
      report.cause == control::SafetyCause::kVentRequested && !report.vent_overdue;
  if (report.state == SafetyState::kFault && !asked_for) return ros::console::levels::Error;
  if (report.state == SafetyState::kVented && !asked_for) return ros::console::levels::Warn;
  return ros::console::levels::Info;
}

bool PressureLoop::onEnable(const Trigger::Request&, Trigger::Response& response) {
  const regulator::PriorityLock lock(mutex_);
  const double now = regulator::steadyNow();
  const std::string refusal = path_.enable(now);
  turn(now);
  if (refusal.empty()) rested_.release();
  response.success = refusal.empty();
  response.message = refusal.empty() ? path_.reason() : refusal;
  return true;
}

bool PressureLoop::onRest(ros::ServiceEvent<Trigger::Request, Trigger::Response>& call) {
  const std::string& caller = call.getCallerName();
  Trigger::Response& response = call.getResponse();
  const regulator::PriorityLock lock(mutex_);
  const double now = regulator::steadyNow();
  response.success = path_.core().rest(now);
  if (response.success && caller != commander_) rested_.hold(caller, now);
  rested_.acknowledge(caller);
  turn(now);
  response.message = (response.success ? "" : "not enabled, so nothing changes: ") + path_.reason();
  return true;
}

bool PressureLoop::onVent(const Trigger::Request&, Trigger::Response& response) {
  const regulator::PriorityLock lock(mutex_);
  const double now = regulator::steadyNow();
  path_.core().vent(now);
  turn(now);
  response.success = path_.core().linked();
  response.message = path_.reason();
  return true;
}

bool PressureLoop::onStop(const SetBool::Request& request, SetBool::Response& response) {
  const regulator::PriorityLock lock(mutex_);
  const double now = regulator::steadyNow();
  path_.core().emergencyStop(now, request.data);
  turn(now);
  response.success = path_.core().linked() || !request.data;
  response.message = path_.reason();
  return true;
}

void PressureLoop::onReading(const PressureArrayConstPtr& reading) {
  const regulator::PriorityLock lock(mutex_);
  const auto checked = control::checkReading(arm_, reading->name, reading->pressure);
  const double age = ageOf(reading->header.stamp);
  auto refusal =
      control::checkAge(age, path_.core().rules().reading_timeout, control::Timed::kReading);
  if (const auto* other = std::get_if<control::Refusal>(&checked)) refusal = *other;
  if (refusal) {
    if (!bad_readings_.add()) return;
    logWarning("a message on pressure_measured was dropped: %s", refusal->message.c_str());
    return;
  }
  const auto& measured = std::get<Eigen::VectorXd>(checked);
  path_.core().measured(regulator::steadyNow(), measured, std::numeric_limits<double>::quiet_NaN(),
                        age);
  post({measured, path_.core().orders().set_point, reading->header.stamp});
}

void PressureLoop::turn(double now) {
  path_.turn(now);
  publish(now);
}

void PressureLoop::publish(double now) {
  std_msgs::Header header = toHeaderMsg(ros::Time::now());
  command_publisher_.publish(toPressureMsg(header, arm_, path_.core().orders().set_point));
  noteChanges(header.stamp);
  const regulator::Reading* news = path_.news();
  if (news == nullptr || !news->pressures.pressure.allFinite()) return;
  // Simulated time may stand still or not have started.
  if (ros::Time::isSystemTime()) header.stamp -= ros::Duration(now - news->time);
  measured_publisher_.publish(toPressureMsg(header, arm_, news->pressures.pressure));
  post({news->pressures.pressure, path_.core().orders().set_point, header.stamp});
}

void PressureLoop::noteChanges(const ros::Time& stamp) {
  const control::SafetyReport& report = path_.core().report();
  if (changes_noted_ == report.changes) return;
  changes_noted_ = report.changes;
  const SafetyState message = toSafetyMsg(stamp, path_);
  safety_publisher_.publish(message);
  logLine(levelOf(report), "%s", message.reason.c_str());
}

void PressureLoop::post(Reading reading) {
  waiting_.push_back(std::move(reading));
  if (waiting_.size() > kMostReadings) waiting_.erase(waiting_.begin());
  if (waiting_.size() > 1) return;
  ros::getGlobalCallbackQueue()->addCallback(boost::make_shared<Taking>(this),
                                             reinterpret_cast<std::uint64_t>(this));
}

void PressureLoop::run() {
  regulator::scheduleRealtime(realtime_priority_);
  // On its own clock, since the thread of ROS timers has no real-time priority.
  for (double due = regulator::steadyNow(); !ends_;) {
    const double now = regulator::steadyNow();
    if (now < due) {
      queue_.callAvailable(ros::WallDuration(due - now));
      continue;
    }
    {
      const regulator::PriorityLock lock(mutex_);
      ++turns_;
      turn(regulator::steadyNow());
    }
    due = std::max(due + period_, now);
    queue_.callAvailable();  // even if the turns are late
  }
}

void PressureLoop::takeWaiting() {
  std::vector<Reading> readings;
  {
    const regulator::PriorityLock lock(mutex_);
    readings.swap(waiting_);
  }
  if (readings.size() == kMostReadings) readings.erase(readings.begin(), readings.end() - 1);
  for (const Reading& reading : readings) {
    take_guard_.run("", [&] { take_(reading); });
  }
}

}  // namespace helix_arm::ros_bridge
