#pragma once

#include <algorithm>
#include <atomic>
#include <cstdint>
#include <functional>
#include <limits>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <variant>
#include <vector>

#include <ros/callback_queue.h>
#include <ros/node_handle.h>
#include <ros/spinner.h>
#include <std_srvs/SetBool.h>
#include <std_srvs/Trigger.h>

#include "helix_arm/PressureArray.h"
#include "helix_arm/SafetyState.h"
#include "helix_arm/basics/mutex.hpp"
#include "helix_arm/control/commander_lease.hpp"
#include "helix_arm/control/safety.hpp"
#include "helix_arm/control/target_check.hpp"
#include "helix_arm/model/arm.hpp"
#include "helix_arm/regulator/guard_process.hpp"
#include "helix_arm/regulator/realtime.hpp"
#include "helix_arm/regulator/regulator_io.hpp"
#include "ros_bridge/common/conversions.hpp"
#include "ros_bridge/common/diagnostics.hpp"
#include "ros_bridge/common/guarded_callbacks.hpp"
#include "ros_bridge/common/run_node.hpp"
#include "ros_bridge/names.hpp"

namespace helix_arm::ros_bridge {

/// The pressure path of a node in its own thread: no other work of the node delays it, or a stop.
///
/// Readings from a topic have their own thread too, so that they cannot delay a stop.
///
/// Publishes pressure_command, immediately on a new target and with every turn; pressure_measured,
/// if the regulator is the node's own; and safety_state, latched, on every change, with a line in
/// the log. Serves ~enable, ~rest, ~vent and ~emergency_stop. All times are of the steady clock.
class PressureLoop {
 public:
  /// A reading, and the command in force.
  struct Reading {
    Eigen::VectorXd pressure, set_point;  ///< (n) gauge [Pa]
    ros::Time stamp;
  };
  using Take = std::function<void(const Reading&)>;
  /// Why a target (n) [Pa] is not let through; nothing if it may be commanded.
  using Gate = std::function<std::optional<control::Refusal>(const PressureLoop& loop,
                                                             const Eigen::VectorXd& target)>;

  /// The pressure path at one moment.
  struct Snapshot {
    control::SafetyReport report;
    std::string reason;
    control::ValveOrders orders;
    Eigen::VectorXd goal, reading;          ///< (n) [Pa]; reading NaN before the first
    std::optional<regulator::IoStatus> io;  ///< where the regulator is the node's own
    std::uint64_t turns = 0;                ///< so far
    FaultCount bad_readings;
  };

  /// @param arm                Its actuators are named in the messages.
  /// @param rate               Turns of the loop per second [Hz].
  /// @param realtime_priority  Of its thread, as scheduleRealtime(), where that is allowed.
  /// @param path               Without I/O, readings come from pressure_measured of another node.
  /// @param auto_enable        A target enables the path, as SafetyCore::mayEnableItself() allows.
  /// @param gate               Asked before each command, in the thread that commands.
  /// @param take               Receives the readings, in order, from the node's own callback
  ///                           queue; only the last where it cannot keep up.
  PressureLoop(ros::NodeHandle node, const model::Arm& arm, double rate, int realtime_priority,
               regulator::PressurePath path, bool auto_enable, Gate gate, Take take)
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

  ~PressureLoop() {
    end();
    ros::getGlobalCallbackQueue()->removeByID(reinterpret_cast<std::uint64_t>(this));
  }

  /// Sets the target of a commander: (n), inside the limits [Pa]. After a rest that another asked
  /// for, it is refused until it pauses for target_timeout, asks for rest, or the arm is enabled.
  /// A target that the gate refuses leaves the command as it is; its commander is not silent.
  std::optional<control::Refusal> command(const std::string& commander,
                                          const Eigen::VectorXd& pressure)
      HELIX_ARM_EXCLUDES(mutex_) {
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

  /// Keeps the set points where they are, unless the arm goes to rest.
  void hold() HELIX_ARM_EXCLUDES(mutex_) {
    const regulator::PriorityLock lock(mutex_);
    if (path_.core().report().resting) return;
    path_.target(regulator::steadyNow(), path_.core().orders().set_point);
  }

  /// Replaces the rules of the same channels, and the arm with the same actuators.
  /// @throws std::invalid_argument as SafetyCore::adopt; the old ones stay.
  void adopt(const model::Arm& arm, std::vector<control::ChannelRules> channels,
             const control::SafetyRules& rules) HELIX_ARM_EXCLUDES(mutex_) {
    const regulator::PriorityLock lock(mutex_);
    path_.core().adopt(std::move(channels), rules);
    arm_ = arm;
  }

  /// As PressurePath::guardedBy().
  void guardedBy(std::shared_ptr<const regulator::GuardProcess> guard) HELIX_ARM_EXCLUDES(mutex_) {
    const regulator::PriorityLock lock(mutex_);
    path_.guardedBy(std::move(guard));
  }
  /// If the regulator is the node's own, vents and waits for a limited time until no pressure
  /// remains. Does nothing from then on.
  /// @return whether the readings confirm that it is vented.
  bool end() HELIX_ARM_EXCLUDES(mutex_) {
    ends_ = true;
    thread_.join();
    reading_spinner_.stop();
    const regulator::PriorityLock lock(mutex_);
    return path_.end();
  }
  /// Exit code of the node as far as the loop is concerned.
  int verdict() const { return thread_.verdict(); }

  /// (n) target of the commands [Pa]
  Eigen::VectorXd goal() const HELIX_ARM_EXCLUDES(mutex_) {
    const regulator::PriorityLock lock(mutex_);
    return arm_.clamped(path_.core().goal());  // a vented channel is at the atmosphere
  }

  Snapshot snapshot() const HELIX_ARM_EXCLUDES(mutex_) {
    const regulator::PriorityLock lock(mutex_);
    const control::SafetyCore& core = path_.core();
    Snapshot out{core.report(),  path_.reason(), core.orders(), core.goal(),
                 core.reading(), std::nullopt,   turns_,        bad_readings_};
    if (path_.io() != nullptr) out.io = path_.io()->status();
    return out;
  }

 private:
  using Trigger = std_srvs::Trigger;
  using SetBool = std_srvs::SetBool;

  /// If more readings wait, the receiver is slower than the loop and gets only the last one.
  static constexpr std::size_t kMostReadings = 4;

  /// Takes the readings that wait, as an entry of the node's callback queue.
  struct Taking : ros::CallbackInterface {
    explicit Taking(PressureLoop* of) : loop(of) {}
    CallResult call() override {
      loop->takeWaiting();
      return Success;
    }
    PressureLoop* const loop;
  };

  static ros::NodeHandle onQueue(ros::NodeHandle node, ros::CallbackQueue& queue) {
    node.setCallbackQueue(&queue);
    return node;
  }

  /// Age of a reading [s]; 0 without a stamp, and in simulated time, which may outrun real time.
  static double ageOf(const ros::Time& stamp) {
    if (stamp.isZero() || !ros::Time::isSystemTime()) return 0;
    return ros::Time::now().toSec() - stamp.toSec();
  }

  static SafetyState toSafetyMsg(const ros::Time& stamp, const regulator::PressurePath& path) {
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

  static LogLevel levelOf(const control::SafetyReport& report) {
    using control::SafetyState;
    const bool asked_for =
        report.cause == control::SafetyCause::kVentRequested && !report.vent_overdue;
    if (report.state == SafetyState::kFault && !asked_for) return ros::console::levels::Error;
    if (report.state == SafetyState::kVented && !asked_for) return ros::console::levels::Warn;
    return ros::console::levels::Info;
  }

  bool onEnable(const Trigger::Request&, Trigger::Response& response) {
    const regulator::PriorityLock lock(mutex_);
    const double now = regulator::steadyNow();
    const std::string refusal = path_.enable(now);
    turn(now);
    if (refusal.empty()) rested_.release();
    response.success = refusal.empty();
    response.message = refusal.empty() ? path_.reason() : refusal;
    return true;
  }

  bool onRest(ros::ServiceEvent<Trigger::Request, Trigger::Response>& call) {
    const std::string& caller = call.getCallerName();
    Trigger::Response& response = call.getResponse();
    const regulator::PriorityLock lock(mutex_);
    const double now = regulator::steadyNow();
    response.success = path_.core().rest(now);
    if (response.success && caller != commander_) rested_.hold(caller, now);
    rested_.acknowledge(caller);
    turn(now);
    response.message =
        (response.success ? "" : "not enabled, so nothing changes: ") + path_.reason();
    return true;
  }

  bool onVent(const Trigger::Request&, Trigger::Response& response) {
    const regulator::PriorityLock lock(mutex_);
    const double now = regulator::steadyNow();
    path_.core().vent(now);
    turn(now);
    response.success = path_.core().linked();
    response.message = path_.reason();
    return true;
  }

  bool onStop(const SetBool::Request& request, SetBool::Response& response) {
    const regulator::PriorityLock lock(mutex_);
    const double now = regulator::steadyNow();
    path_.core().emergencyStop(now, request.data);
    turn(now);
    response.success = path_.core().linked() || !request.data;
    response.message = path_.reason();
    return true;
  }

  void onReading(const PressureArrayConstPtr& reading) {
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
    path_.core().measured(regulator::steadyNow(), measured,
                          std::numeric_limits<double>::quiet_NaN(), age);
    post({measured, path_.core().orders().set_point, reading->header.stamp});
  }

  void turn(double now) HELIX_ARM_REQUIRES(mutex_) {
    path_.turn(now);
    publish(now);
  }

  void publish(double now) HELIX_ARM_REQUIRES(mutex_) {
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

  void noteChanges(const ros::Time& stamp) HELIX_ARM_REQUIRES(mutex_) {
    const control::SafetyReport& report = path_.core().report();
    if (changes_noted_ == report.changes) return;
    changes_noted_ = report.changes;
    const SafetyState message = toSafetyMsg(stamp, path_);
    safety_publisher_.publish(message);
    logLine(levelOf(report), "%s", message.reason.c_str());
  }

  void post(Reading reading) HELIX_ARM_REQUIRES(mutex_) {
    waiting_.push_back(std::move(reading));
    if (waiting_.size() > kMostReadings) waiting_.erase(waiting_.begin());
    if (waiting_.size() > 1) return;
    ros::getGlobalCallbackQueue()->addCallback(boost::make_shared<Taking>(this),
                                               reinterpret_cast<std::uint64_t>(this));
  }

  void run() {
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

  void takeWaiting() HELIX_ARM_EXCLUDES(mutex_) {
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

  const double period_;  ///< [s]
  const int realtime_priority_;
  const bool auto_enable_;
  const Gate gate_;
  const Take take_;

  mutable regulator::PriorityMutex mutex_;  ///< also orders the commands
  model::Arm arm_ HELIX_ARM_GUARDED_BY(mutex_);
  regulator::PressurePath path_ HELIX_ARM_GUARDED_BY(mutex_);
  std::string commander_ HELIX_ARM_GUARDED_BY(mutex_);  ///< of the last target
  control::RestedCommanders rested_ HELIX_ARM_GUARDED_BY(mutex_);
  std::uint64_t turns_ HELIX_ARM_GUARDED_BY(mutex_) = 0;
  std::optional<std::uint64_t> changes_noted_ HELIX_ARM_GUARDED_BY(mutex_);
  FaultCount bad_readings_ HELIX_ARM_GUARDED_BY(mutex_);
  std::vector<Reading> waiting_ HELIX_ARM_GUARDED_BY(mutex_);

  ros::CallbackQueue queue_;  ///< queue of the members below, which leave it when destroyed
  ros::Publisher command_publisher_, measured_publisher_, safety_publisher_;
  ros::ServiceServer enable_server_, rest_server_, vent_server_, stop_server_;
  /// For the readings only, so that no reading, however large, delays a stop.
  ros::CallbackQueue reading_queue_;
  ros::Subscriber reading_subscriber_;
  ros::AsyncSpinner reading_spinner_;
  FaultGuard take_guard_;
  std::atomic<bool> ends_{false};
  GuardedThread thread_;  ///< of the queue and the turns
};

}  // namespace helix_arm::ros_bridge
