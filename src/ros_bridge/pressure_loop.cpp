#include "helix_arm/ros_bridge/pressure_loop.hpp"

#include <cstddef>
#include <utility>

#include <boost/make_shared.hpp>
#include <ros/console.h>

#include "helix_arm/SafetyState.h"
#include "helix_arm/ros_bridge/conversions.hpp"
#include "helix_arm/ros_bridge/names.hpp"

namespace helix_arm::ros_bridge {
namespace {

using control::SafetyCause;
using control::SafetyState;
using regulator::steadyNow;

// More readings than these waiting: whoever takes them is slower than the loop, and gets the last.
constexpr std::size_t kMostWaiting = 4;

// What a callback queue holds.
class Call : public ros::CallbackInterface {
 public:
  explicit Call(std::function<void()> call) : call_(std::move(call)) {}
  CallResult call() override {
    call_();
    return Success;
  }

 private:
  std::function<void()> call_;
};

helix_arm::SafetyState toSafetyMsg(const ros::Time& stamp, const regulator::PressurePath& path) {
  const control::SafetyCore& core = path.core();
  const control::SafetyReport& report = core.report();
  helix_arm::SafetyState out;
  out.header.stamp = stamp;
  out.state = nameOf(report.state);
  out.cause = nameOf(report.cause);
  out.reason = path.reason();
  if (report.channel >= 0) {
    out.actuator = core.channels()[static_cast<std::size_t>(report.channel)].name;
  }
  out.value = report.value;
  out.limit = report.limit;
  out.stopped = report.stopped;
  out.vent_overdue = report.vent_overdue;
  return out;
}

// Before it is enabled for the first time, and after what has passed by itself.
bool mayEnableItself(const control::SafetyReport& report) {
  if (report.state == SafetyState::kDisabled) return true;
  return report.state == SafetyState::kVented &&
         (report.cause == SafetyCause::kStaleTarget || report.cause == SafetyCause::kStaleReading ||
          report.cause == SafetyCause::kRegulatorLost);
}

LogThread::Level levelOf(const control::SafetyReport& report) {
  const bool asked_for = report.cause == SafetyCause::kVentRequested && !report.vent_overdue;
  if (report.state == SafetyState::kFault && !asked_for) return ros::console::levels::Error;
  if (report.state == SafetyState::kVented && !asked_for) return ros::console::levels::Warn;
  return ros::console::levels::Info;
}

}  // namespace

template <class Change>
void PressureLoop::act(const Change& change) {
  const std::lock_guard<std::mutex> lock(mutex_);
  change(steadyNow());
}

PressureLoop::PressureLoop(ros::NodeHandle node, const model::Arm& arm, double rate,
                           regulator::PressurePath path, bool auto_enable, Take take)
    : auto_enable_(auto_enable),
      take_(std::move(take)),
      arm_(arm),
      path_(std::move(path)),
      command_publisher_(node.advertise<PressureArray>(names::kPressureCommand, 10)),
      safety_publisher_(node.advertise<helix_arm::SafetyState>(names::kSafetyState, 10, true)),
      spinner_(1, &queue_),
      reading_spinner_(1, &reading_queue_),
      take_guard_("a reading") {
  node.setCallbackQueue(&queue_);
  // Nothing here waits for the log.
  const FaultGuard::Log log = [this](const std::string& line) {
    log_.write(ros::console::levels::Warn, line);
  };
  if (path_.io() != nullptr) {
    measured_publisher_ = node.advertise<PressureArray>(names::kPressureMeasured, 10);
  } else {
    ros::NodeHandle other = node;
    other.setCallbackQueue(&reading_queue_);
    reading_subscriber_ =
        listen(other, names::kPressureMeasured, 10, &PressureLoop::onReading, this, log);
  }
  ros::NodeHandle below("~");
  below.setCallbackQueue(&queue_);
  enable_server_ = serve(below, names::kEnable, &PressureLoop::onEnable, this, log);
  vent_server_ = serve(below, names::kVent, &PressureLoop::onVent, this, log);
  stop_server_ = serve(below, names::kEmergencyStop, &PressureLoop::onStop, this, log);
  timer_ = repeat(node, "the pressure loop", 1.0 / rate, &PressureLoop::onTurn, this, log);
  spinner_.start();
  reading_spinner_.start();
}

PressureLoop::~PressureLoop() {
  end();
  ros::getGlobalCallbackQueue()->removeByID(reinterpret_cast<std::uint64_t>(this));
}

bool PressureLoop::end() {
  timer_.stop();
  spinner_.stop();
  reading_spinner_.stop();
  return path_.end();
}

std::string PressureLoop::command(const Eigen::VectorXd& pressure) {
  std::string refusal;
  act([&](double now) {
    control::SafetyCore& core = path_.core();
    if (auto_enable_ && mayEnableItself(core.report())) refusal = path_.enable(now);
    if (refusal.empty() && !path_.target(now, pressure)) refusal = path_.reason();
    publish(now);
  });
  return refusal;
}

void PressureLoop::adopt(const model::Arm& arm, std::vector<control::ChannelRules> channels,
                         const control::SafetyRules& rules) {
  const std::lock_guard<std::mutex> lock(mutex_);
  path_.core().adopt(std::move(channels), rules);
  arm_ = arm;
}

void PressureLoop::vent(SafetyCause why) {
  act([&](double now) {
    path_.core().vent(now, why);
    turn(now);
  });
}

Eigen::VectorXd PressureLoop::goal() const {
  const std::lock_guard<std::mutex> lock(mutex_);
  return arm_.clamped(path_.core().goal());  // of one that vents it is the atmosphere
}

PressureLoop::Snapshot PressureLoop::snapshot() const {
  const std::lock_guard<std::mutex> lock(mutex_);
  const control::SafetyCore& core = path_.core();
  Snapshot out{core.report(),  path_.reason(), core.orders(), core.goal(),
               core.reading(), std::nullopt,   turns_,        bad_readings_};
  if (path_.io() != nullptr) out.io = path_.io()->status();
  return out;
}

bool PressureLoop::onEnable(Trigger::Request&, Trigger::Response& response) {
  act([&](double now) {
    const std::string refusal = path_.enable(now);
    turn(now);
    response.success = refusal.empty();
    response.message = refusal.empty() ? path_.reason() : refusal;
  });
  return true;
}

bool PressureLoop::onVent(Trigger::Request&, Trigger::Response& response) {
  act([&](double now) {
    path_.core().vent(now);
    turn(now);
    response.success = path_.core().linked();
    response.message = path_.reason();
  });
  return true;
}

bool PressureLoop::onStop(SetBool::Request& request, SetBool::Response& response) {
  act([&](double now) {
    path_.core().emergencyStop(now, request.data);
    turn(now);
    response.success = path_.core().linked() || !request.data;
    response.message = path_.reason();
  });
  return true;
}

void PressureLoop::onTurn(const ros::SteadyTimerEvent&) {
  act([this](double now) {
    ++turns_;
    turn(now);
  });
}

void PressureLoop::onReading(const PressureArrayConstPtr& reading) {
  const std::lock_guard<std::mutex> lock(mutex_);
  const auto checked = control::checkReading(arm_, reading->name, reading->pressure);
  if (const auto* measured = std::get_if<Eigen::VectorXd>(&checked)) {
    path_.core().measured(steadyNow(), *measured);
    post({*measured, reading->header.stamp});
  } else if (bad_readings_.add()) {
    log_.write(ros::console::levels::Warn, "pressure_measured is not of this arm: " +
                                               std::get<control::Refusal>(checked).message);
  }
}

void PressureLoop::turn(double now) {
  path_.turn(now);
  publish(now);
}

void PressureLoop::publish(double now) {
  std_msgs::Header header;
  header.stamp = ros::Time::now();
  command_publisher_.publish(toPressureMsg(header, arm_, path_.core().orders().set_point));
  noteChanges(header.stamp);
  const regulator::Reading* news = path_.news();
  if (news == nullptr || !news->pressures.pressure.allFinite()) return;
  // Simulated time may stand still, or not have begun.
  if (ros::Time::isSystemTime()) header.stamp -= ros::Duration(now - news->time);
  measured_publisher_.publish(toPressureMsg(header, arm_, news->pressures.pressure));
  post({news->pressures.pressure, header.stamp});
}

void PressureLoop::noteChanges(const ros::Time& stamp) {
  const control::SafetyReport& report = path_.core().report();
  if (changes_noted_ == report.changes) return;
  changes_noted_ = report.changes;
  const helix_arm::SafetyState message = toSafetyMsg(stamp, path_);
  safety_publisher_.publish(message);
  log_.write(levelOf(report), message.reason);
}

void PressureLoop::post(Reading reading) {
  waiting_.push_back(std::move(reading));
  if (waiting_.size() > kMostWaiting) waiting_.erase(waiting_.begin());
  if (waiting_.size() > 1) return;
  ros::getGlobalCallbackQueue()->addCallback(boost::make_shared<Call>([this] { takeWaiting(); }),
                                             reinterpret_cast<std::uint64_t>(this));
}

void PressureLoop::takeWaiting() {
  std::vector<Reading> readings;
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    readings.swap(waiting_);
  }
  if (readings.size() == kMostWaiting) readings.erase(readings.begin(), readings.end() - 1);
  for (const Reading& reading : readings) {
    take_guard_.run("", [&] { take_(reading); });
  }
}

}  // namespace helix_arm::ros_bridge
