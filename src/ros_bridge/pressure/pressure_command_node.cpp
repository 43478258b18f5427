#include <filesystem>

#include <ros/callback_queue.h>
#include <ros/spinner.h>
#include <ros/this_node.h>
#include <std_srvs/SetBool.h>
#include <std_srvs/Trigger.h>
#include <tf2_ros/static_transform_broadcaster.h>

#include "helix_arm/Forward.h"
#include "helix_arm/Inverse.h"
#include "helix_arm/PressureArray.h"
#include "helix_arm/SafetyState.h"
#include "helix_arm/ShapeTarget.h"
#include "helix_arm/basics/mutex.hpp"
#include "helix_arm/basics/quote.hpp"
#include "helix_arm/basics/requirement.hpp"
#include "helix_arm/basics/text.hpp"
#include "helix_arm/control/commander_lease.hpp"
#include "helix_arm/control/safety.hpp"
#include "helix_arm/control/target_check.hpp"
#include "helix_arm/io/scene.hpp"
#include "helix_arm/lie/so3.hpp"
#include "helix_arm/model/arm_response.hpp"
#include "helix_arm/regulator/config.hpp"
#include "helix_arm/regulator/guard_process.hpp"
#include "helix_arm/regulator/realtime.hpp"
#include "helix_arm/regulator/regulator_io.hpp"
#include "helix_arm/statics/arm_model.hpp"
#include "helix_arm/statics/inverse.hpp"
#include "ros_bridge/common/arm_frames.hpp"
#include "ros_bridge/common/arm_markers.hpp"
#include "ros_bridge/common/conversions.hpp"
#include "ros_bridge/common/diagnostics.hpp"
#include "ros_bridge/common/guarded_callbacks.hpp"
#include "ros_bridge/common/parameters.hpp"
#include "ros_bridge/common/run_node.hpp"
#include "ros_bridge/names.hpp"
#include "target_admission.hpp"

namespace helix_arm::ros_bridge {
namespace {

using diagnostic_msgs::DiagnosticStatus;

/// Private parameters of pressure_command.
struct PressureCommandOptions {
  ParameterReader reader{ros::NodeHandle("~")};
  std::string scene = reader.file("scene", "config/scenes", ".yaml");
  double rate = reader.number("rate", 100.0, {1.0, 1000.0});  ///< of the loop [Hz]
  /// Of the moving frames, at most the loop's [Hz].
  double tf_rate = std::min(rate, reader.number("tf_rate", 100.0, {0.1, 1000.0}));
  double draw_rate = reader.number("draw_rate", 20.0, {0.1, 100.0});  ///< of the markers [Hz]
  int frames = reader.count("frames", 5, 2, 1000);  ///< on the curve: model_0 .. model_(frames - 1)
  std::string world_frame = reader.frame("world_frame", names::kWorldFrame);
  std::string frame_prefix = reader.frame("frame_prefix", "");  ///< of arm_base and model_*
  bool handle = reader.flag("handle", true);                    ///< show the interactive marker
  /// `scene` drives the scene's regulator, hardware or simulated, from this node; `topic` leaves
  /// the pressures to another node, which reports them on pressure_measured.
  std::string regulator = reader.choice("regulator", "scene", {"scene", "topic"});
  /// A target enables the arm, first and after commander or regulator fell silent; never hardware.
  bool auto_enable = reader.flag("auto_enable", regulator == "scene");
  /// Drive hardware although ROS time is simulated; the safety rules run on the steady clock.
  bool allow_sim_time = reader.flag("allow_sim_time", false);
  /// Of the threads between targets and valves (SCHED_FIFO), and of the guard, if the user's limits
  /// allow it; the log reports the result. 0: none. With hardware, memory is locked as well.
  int realtime_priority = reader.count("realtime_priority", regulator::kRealtimePriority, 0,
                                       regulator::kHighestRealtimePriority);
  /// From which ~reload accepts scenes, besides those of the package and ~scene.
  std::string scene_folder = reader.folder("scene_folder", defaultFolder());

  PressureCommandOptions() { reader.finish(); }
};

constexpr double kSlowShare = 0.9;  // of ~rate; a slower loop is worth a warning

// A target is reached once at rest: while the arm creeps, its pressures are not changed.
constexpr model::AfterMove kTargetAt = model::AfterMove::kAtRest;
constexpr double kFresh = 1.0;  // a longer silence of the regulator is an error [s]

// By control::Valve.
constexpr const char* kValves[] = {"vent", "regulate", "close"};

using regulator::steadyNow;

// If more readings wait, the receiver is slower than the loop and gets only the last one.
constexpr std::size_t kMostReadings = 4;

// A function as an entry of a callback queue.
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

ros::NodeHandle onQueue(ros::NodeHandle node, ros::CallbackQueue& queue) {
  node.setCallbackQueue(&queue);
  return node;
}

// Age of a reading [s]; 0 without a stamp, and in simulated time, which may outrun real time.
double ageOf(const ros::Time& stamp) {
  if (stamp.isZero() || !ros::Time::isSystemTime()) return 0;
  return ros::Time::now().toSec() - stamp.toSec();
}

helix_arm::SafetyState toSafetyMsg(const ros::Time& stamp, const regulator::PressurePath& path) {
  const control::SafetyCore& core = path.core();
  const control::SafetyReport& report = core.report();
  helix_arm::SafetyState out;
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

LogLevel levelOf(const control::SafetyReport& report) {
  using control::SafetyState;
  const bool asked_for =
      report.cause == control::SafetyCause::kVentRequested && !report.vent_overdue;
  if (report.state == SafetyState::kFault && !asked_for) return ros::console::levels::Error;
  if (report.state == SafetyState::kVented && !asked_for) return ros::console::levels::Warn;
  return ros::console::levels::Info;
}

/// The pressure path of a node in its own thread: no other work of the node delays it, or a stop.
///
/// Readings from a topic have their own thread too, so that they cannot delay a stop.
///
/// Publishes pressure_command, immediately on a new target and with every turn; pressure_measured,
/// if the regulator is the node's own; and safety_state, latched, on every change, with a line in
/// the log. Serves ~enable, ~rest, ~vent and ~emergency_stop. All times are of the steady clock.
class PressureLoop {
 public:
  /// A reading.
  struct Reading {
    Eigen::VectorXd pressure;  ///< (n) gauge [Pa]
    ros::Time stamp;
  };
  using Take = std::function<void(const Reading&)>;

  /// The pressure path at one moment.
  struct Snapshot {
    control::SafetyReport report;
    std::string reason;
    control::ValveOrders orders;
    Eigen::VectorXd goal, reading;          ///< (n) [Pa]
    std::optional<regulator::IoStatus> io;  ///< where the regulator is the node's own
    std::uint64_t turns = 0;                ///< so far
    FaultCount bad_readings;
  };

  /// @param arm                Its actuators are named in the messages.
  /// @param rate               Turns of the loop per second [Hz].
  /// @param realtime_priority  Of its thread, as scheduleRealtime(), where that is allowed.
  /// @param path               Without I/O, readings come from pressure_measured of another node.
  /// @param auto_enable        A target enables the path, as SafetyCore::mayEnableItself() allows.
  /// @param take               Receives the readings, in order, from the node's own callback
  ///                           queue; only the last where it cannot keep up.
  PressureLoop(ros::NodeHandle node, const model::Arm& arm, double rate, int realtime_priority,
               regulator::PressurePath path, bool auto_enable, Take take)
      : period_(1.0 / rate),
        realtime_priority_(realtime_priority),
        auto_enable_(auto_enable),
        take_(std::move(take)),
        arm_(arm),
        path_(std::move(path)),
        command_publisher_(node.advertise<PressureArray>(names::kPressureCommand, 10)),
        safety_publisher_(node.advertise<helix_arm::SafetyState>(names::kSafetyState, 10, true)),
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
    rest_server_ = serve(below, names::kRest, &PressureLoop::onRest, this);
    vent_server_ = serve(below, names::kVent, &PressureLoop::onVent, this);
    stop_server_ = serve(below, names::kEmergencyStop, &PressureLoop::onStop, this);
    reading_spinner_.start();
    thread_.start([this] { run(); });
  }
  ~PressureLoop() {
    end();
    ros::getGlobalCallbackQueue()->removeByID(reinterpret_cast<std::uint64_t>(this));
  }
  PressureLoop(const PressureLoop&) = delete;
  PressureLoop& operator=(const PressureLoop&) = delete;

  /// Sets the target of a commander: (n), inside the limits [Pa]. After a rest that another asked
  /// for, it is refused until it pauses for target_timeout, asks for rest, or the arm is enabled.
  std::optional<control::Refusal> command(const std::string& commander,
                                          const Eigen::VectorXd& pressure)
      HELIX_ARM_EXCLUDES(mutex_) {
    const regulator::PriorityLock lock(mutex_);
    const double now = steadyNow();
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

  bool onEnable(const Trigger::Request&, Trigger::Response& response) {
    const regulator::PriorityLock lock(mutex_);
    const double now = steadyNow();
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
    const double now = steadyNow();
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
    const double now = steadyNow();
    path_.core().vent(now);
    turn(now);
    response.success = path_.core().linked();
    response.message = path_.reason();
    return true;
  }
  bool onStop(const SetBool::Request& request, SetBool::Response& response) {
    const regulator::PriorityLock lock(mutex_);
    const double now = steadyNow();
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
    path_.core().measured(steadyNow(), measured, std::numeric_limits<double>::quiet_NaN(), age);
    post({measured, reading->header.stamp});
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
    post({news->pressures.pressure, header.stamp});
  }
  void noteChanges(const ros::Time& stamp) HELIX_ARM_REQUIRES(mutex_) {
    const control::SafetyReport& report = path_.core().report();
    if (changes_noted_ == report.changes) return;
    changes_noted_ = report.changes;
    const helix_arm::SafetyState message = toSafetyMsg(stamp, path_);
    safety_publisher_.publish(message);
    logLine(levelOf(report), "%s", message.reason.c_str());
  }
  void post(Reading reading) HELIX_ARM_REQUIRES(mutex_) {
    waiting_.push_back(std::move(reading));
    if (waiting_.size() > kMostReadings) waiting_.erase(waiting_.begin());
    if (waiting_.size() > 1) return;
    ros::getGlobalCallbackQueue()->addCallback(boost::make_shared<Call>([this] { takeWaiting(); }),
                                               reinterpret_cast<std::uint64_t>(this));
  }

  void run() {
    regulator::scheduleRealtime(realtime_priority_);
    // On its own clock, since the thread of ROS timers has no real-time priority.
    for (double due = steadyNow(); !ends_;) {
      const double now = steadyNow();
      if (now < due) {
        queue_.callAvailable(ros::WallDuration(due - now));
        continue;
      }
      {
        const regulator::PriorityLock lock(mutex_);
        ++turns_;
        turn(steadyNow());
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

unsigned char diagnosticLevel(const control::SafetyReport& report) {
  using control::SafetyCause;
  if (report.vent_overdue) return DiagnosticStatus::ERROR;
  if (report.cause == SafetyCause::kNone) return DiagnosticStatus::OK;
  if (report.cause == SafetyCause::kVentRequested) return DiagnosticStatus::WARN;
  const bool enabled = report.state == control::SafetyState::kEnabled;
  return enabled ? DiagnosticStatus::OK : DiagnosticStatus::ERROR;
}

DiagnosticStatus safetyStatus(const io::Scene& scene, const PressureLoop::Snapshot& path) {
  const control::SafetyReport& report = path.report;
  return makeStatus(names::kSafetyStatus, diagnosticLevel(report), path.reason,
                    {{"state", nameOf(report.state)},
                     {"cause", nameOf(report.cause)},
                     {"emergency_stop", report.stopped ? "engaged" : "released"},
                     {"vent_overdue", report.vent_overdue ? "true" : "false"},
                     {names::kTargetTimeoutKey, fixed(scene.safety.rules.target_timeout, 3)}});
}

DiagnosticStatus regulatorStatus(const io::Scene& scene, const regulator::IoStatus& io) {
  return makeStatus("regulator", io.up ? DiagnosticStatus::OK : DiagnosticStatus::ERROR,
                    io.up ? "the regulator answers" : "no link to the regulator: " + io.last_error,
                    {{"regulator", regulator::describe(*scene.regulator)},
                     {"writes", std::to_string(io.writes)},
                     {"reads", std::to_string(io.reads)},
                     {"bad_replies", std::to_string(io.bad_replies)},
                     {"connections", std::to_string(io.connections)},
                     {"breaks", std::to_string(io.breaks)},
                     {"own_vents", std::to_string(io.own_vents)},
                     {"last_error", io.last_error}});
}

DiagnosticStatus channelStatus(const io::Scene& scene, const PressureLoop::Snapshot& path,
                               int channel) {
  const model::Actuator& actuator = scene.arm.actuator(channel);
  const bool culprit = path.report.channel == channel;
  const char* const valve =
      kValves[static_cast<int>(path.orders.valve[static_cast<std::size_t>(channel)])];
  const auto kpa = [](double pascals) { return fixed(1e-3 * pascals); };
  return makeStatus(names::kChannelStatus + actuator.name,
                    culprit ? diagnosticLevel(path.report) : std::uint8_t{DiagnosticStatus::OK},
                    culprit ? path.reason : valve,
                    {{"valve", valve},
                     {"set_point_kpa", kpa(path.orders.set_point[channel])},
                     {"target_kpa", kpa(path.goal[channel])},
                     {"measured_kpa", kpa(path.reading[channel])},
                     // Rounded to 0.1 kPa, a limit would let through what the arm refuses.
                     {names::kLowerLimitKey, fixed(1e-3 * actuator.limits.lower, 4)},
                     {names::kUpperLimitKey, fixed(1e-3 * actuator.limits.upper, 4)}});
}

/// From measured pressures to the arm's shape: lets the responses of its actuators follow them,
/// solves the model and publishes model, markers, tf and the tip handle. What the responses
/// remember outlasts vents, stops and changes of the scene, not time that goes back.
///
/// Nothing is published where the model finds no shape, and the markers are removed when readings
/// stop; the statuses say so. All of it belongs to the thread of the node's callback queue.
class ShapePublisher {
 public:
  /// @param scene      Kept by reference: after a change, call adopt() before the next reading.
  /// @param on_target  As TipHandle's.
  ShapePublisher(ros::NodeHandle node, const io::Scene& scene,
                 const PressureCommandOptions& options, TipHandle::OnTarget on_target)
      : scene_(scene),
        frames_(options.world_frame, options.frame_prefix, names::kModelFrames, options.frames),
        readings_per_tf_(static_cast<std::uint64_t>(std::lround(options.rate / options.tf_rate))),
        own_regulator_(options.regulator == "scene"),
        markers_(scene, frames_.base, 1.0 / options.draw_rate),
        measured_(scene.arm.inputAt(0)),
        response_(scene.arm),
        solution_(scene.model.solve(measured_)),
        model_publisher_(node.advertise<ArmShape>(names::kModel, 10)),
        marker_publisher_(node.advertise<visualization_msgs::MarkerArray>(names::kMarkers, 2)) {
    sendBaseFrame();
    if (options.handle) {
      handle_ = std::make_unique<TipHandle>(frames_.base, scene, std::move(on_target));
    }
  }

  /// Follows a change of the scene: frames, and the shape at the last reading.
  void adopt() {
    sendBaseFrame();
    response_.adopt(scene_.arm);
    solve();
  }

  /// Publishes the shape at a reading.
  /// @param measured  (n) gauge [Pa]
  void take(const Eigen::VectorXd& measured, const ros::Time& stamp) {
    measured_ = measured;
    const ros::Time at = stamp.isZero() ? ros::Time::now() : stamp;
    if (response_.follow(at.toSec(), measured) && !response_.instant() && restarts_.add()) {
      const double rest = response_.restTime();
      logWarning(
          "pressure_measured is stamped earlier than the reading before (%lu times so far): the "
          "actuators' responses start anew, and their memory is unknown until the pressures have "
          "moved by twice the largest play_kpa%s",
          restarts_.total(),
          (rest > 0 ? basics::format(" and %g s have passed", rest) : "").c_str());
    }
    last_reading_ = ros::SteadyTime::now();
    solve();
    ++readings_;
    if (!solution_.converged()) return;
    const std_msgs::Header header = toHeaderMsg(stamp, frames_.base);
    model_publisher_.publish(toShapeMsg(header, scene_.model.choice(), solution_.shape));
    if (readings_ % readings_per_tf_ == 0) curve_frames_.send(solution_.shape, stamp);
  }

  /// Brings the handle, if any, to the model's tip, if any, once these pressures are effective.
  /// @param goal  (n) gauge [Pa]
  void moveHandle(const Eigen::VectorXd& goal) {
    if (!handle_) return;
    const statics::Tip commanded =
        scene_.model.tip(scene_.arm.clamped(response_.effectiveAt(goal, kTargetAt)));
    if (commanded.converged()) handle_->follow(commanded.tip);
  }
  /// Draws the shape at the last reading, with the state of the arm above its base, or removes it
  /// if that reading is stale or has no shape.
  void draw(const control::SafetyReport& report, const std::string& reason) {
    markers_.tell(report, reason);
    const bool was_drawn = std::exchange(drawn_, measures() && solution_.converged());
    if (drawn_) {
      marker_publisher_.publish(markers_.draw(solution_.shape, measured_, ros::Time::now()));
    } else if (was_drawn) {
      marker_publisher_.publish(markers_.remove(ros::Time::now()));
      if (measures() || !losses_.add()) return;
      logWarning(
          "no pressures were measured for %g s (%lu times so far): %s; the arm is not drawn until "
          "they are",
          kFresh, losses_.total(), unmeasuredText().c_str());
    }
  }

  /// What the actuators remember of their measured pressures.
  const model::ArmResponse& response() const { return response_; }

  const std::string& baseFrame() const { return frames_.base; }

  /// The status `<node>: model`: its tier, and whether it finds a shape.
  DiagnosticStatus status() const {
    const statics::TierChoice& choice = scene_.model.choice();
    const bool solved = solution_.converged();
    DiagnosticStatus out =
        makeStatus(names::kModelStatus, solved ? DiagnosticStatus::OK : DiagnosticStatus::ERROR,
                   solved ? "the model finds the arm's shape"
                          : "the model finds no shape that balances the load: none is published; "
                            "check the scene's load and arm.stiffness.K_eps_n",
                   {{"tier", statics::nameOf(choice.setting.tier)},
                    {"order", std::to_string(choice.setting.order)},
                    {"tier_reason", choice.reason},
                    {"solve_status", statics::nameOf(solution_.status)},
                    {"unsolved", std::to_string(unsolved_.total())}});
    if (response_.instant()) return out;
    addValue(out, "memory_known", response_.known() ? "true" : "false");
    if (response_.restTime() > 0) addValue(out, "rest_time_s", fixed(response_.restTime()));
    addValue(out, "effective_uncertainty_kpa",
             fixed(1e-3 * response_.uncertainty(scene_.arm).maxCoeff()));
    return out;
  }

  /// Sets level and message of a status if there is no fresh reading.
  void reportSilence(DiagnosticStatus& status) const {
    if (measures()) return;
    const bool never = last_reading_.isZero();
    status.level = never ? DiagnosticStatus::WARN : DiagnosticStatus::ERROR;
    status.message = never ? "waits for the first pressure_measured" : unmeasuredText();
  }

 private:
  /// The shape at the effective pressures.
  void solve() {
    const bool rests = last_reading_.isZero();  // before the first reading
    const Eigen::VectorXd pressure = scene_.arm.clamped(rests ? measured_ : response_.effective());
    solution_ = scene_.model.solve(pressure);
    if (solution_.converged() || !unsolved_.add()) return;
    const std::string at = basics::messageOf((1e-3 * pressure).transpose());
    logWarning(
        "%s: the %s model finds no shape that balances the load at %s kPa (%s, residual %.2g; %lu "
        "times so far): no model is published there; check the scene's load and "
        "arm.stiffness.K_eps_n",
        scene_.name.c_str(), scene_.model.choice().setting.name().c_str(), at.c_str(),
        statics::nameOf(solution_.status), solution_.residual, unsolved_.total());
  }

  /// Whether the last reading is fresh.
  bool measures() const {
    return !last_reading_.isZero() &&
           ros::SteadyTime::now() - last_reading_ < ros::WallDuration(kFresh);
  }
  std::string unmeasuredText() const {
    return own_regulator_ ? "the regulator has given no readings (see its diagnostics)"
                          : "no pressure_measured is received; is the regulator's node running?";
  }
  void sendBaseFrame() {
    static_tf_.sendTransform(worldTransform(frames_.world, frames_.base, scene_.X_WB));
  }

  const io::Scene& scene_;
  const FrameNames frames_;
  const std::uint64_t readings_per_tf_;
  const bool own_regulator_;
  ArmMarkers markers_;

  Eigen::VectorXd measured_;  ///< last reading [Pa]
  model::ArmResponse response_;
  statics::Solution solution_;    ///< at the effective pressures, clamped
  ros::SteadyTime last_reading_;  ///< zero: none yet
  std::uint64_t readings_ = 0;
  FaultCount unsolved_;  ///< readings at which the model finds no shape
  FaultCount losses_;    ///< of pressure_measured
  FaultCount restarts_;  ///< of the responses
  bool drawn_ = false;   ///< the arm is on the screen

  ros::Publisher model_publisher_, marker_publisher_;
  CurveFrames curve_frames_{frames_, "pressure_measured is", "it"};
  tf2_ros::StaticTransformBroadcaster static_tf_;
  std::unique_ptr<TipHandle> handle_;
};

/// From a target to a command: checks its values and its stamp, then whether its sender may command
/// the arm, turns shapes and tips into pressures, and commands them.
///
/// Subscribes to pressure_target, shape_target and tip_target; publishes target_status, one answer
/// per target. A target that is not sound, or whose sender may not command, is counted and dropped,
/// and the command stays. All of it belongs to the thread of the node's callback queue.
class TargetIntake {
 public:
  /// @param scene       Kept by reference: after a change, call adopt() before the next target.
  /// @param base_frame  Frame of tip targets.
  /// @param response    Of the arm, as it has followed the measured pressures. Kept by reference.
  /// @param loop        Takes accepted targets; is there before the first one.
  TargetIntake(ros::NodeHandle node, const io::Scene& scene, std::string base_frame,
               const model::ArmResponse& response, std::optional<PressureLoop>& loop)
      : scene_(scene),
        base_frame_(std::move(base_frame)),
        response_(response),
        loop_(loop),
        solver_(scene.model),
        lower_(scene.arm.inputAt(0)),
        upper_(lower_),
        admission_(node, scene),
        subscribers_{
            listen(node, names::kPressureTarget, 10, &TargetIntake::onPressureTarget, this),
            listen(node, names::kShapeTarget, 10, &TargetIntake::onShapeTarget, this),
            listen(node, names::kTipTarget, 10, &TargetIntake::onTipTarget, this)} {}

  /// A target from the interactive marker, whose stamp is not checked.
  void takeFromHandle(const TipTarget& target) {
    aimTip(TargetSender(target.header.stamp), target);
  }

  /// Follows a change of the scene. Whoever holds the lease keeps it.
  void adopt() {
    admission_.adopt();
    solver_ = statics::InverseSolver(scene_.model);
  }

  /// A warning about a commander whose pressures look like kPa, once for each; else empty.
  std::string unitWarning() { return units_.warning(regulator::steadyNow()); }

  /// As TargetAdmission::status().
  DiagnosticStatus status() { return admission_.status(); }

 private:
  void onPressureTarget(const ros::MessageEvent<const PressureArray>& event) {
    const PressureArray& target = *event.getMessage();
    const TargetSender sender(names::kPressureTarget, event);
    const auto checked =
        control::checkPressures(scene_.arm, loop_->goal(), target.name, target.pressure);
    const Eigen::VectorXd* pressure = admission_.admit(sender, checked);
    if (pressure == nullptr || !command(sender, *pressure)) return;
    admission_.accept(sender);
    const auto largest = std::max_element(target.pressure.begin(), target.pressure.end());
    if (largest != target.pressure.end()) units_.note(steadyNow(), sender.commander, *largest);
  }

  void onShapeTarget(const ros::MessageEvent<const ShapeTarget>& event) {
    const TargetSender sender(names::kShapeTarget, event);
    const auto checked = control::checkTwists(scene_.arm.sectionCount(), event.getMessage()->twist);
    if (const model::Twists* twists = admission_.admit(sender, checked)) {
      follow(sender, solver_.toTwists(*twists, beginSearch()));
    }
  }

  void onTipTarget(const ros::MessageEvent<const TipTarget>& event) {
    aimTip({names::kTipTarget, event}, *event.getMessage());
  }

  void aimTip(const TargetSender& sender, const TipTarget& target) {
    const auto checked = fromMsg(target, base_frame_);
    if (const TipGoal* goal = admission_.admit(sender, checked)) {
      const Eigen::VectorXd from = beginSearch();
      follow(sender, goal->with_rotation ? solver_.toPose(goal->X_BT, from)
                                         : solver_.toPosition(goal->X_BT.translation, from));
    }
  }

  /// The command's effective pressure. Limits the search to attainable effective pressures.
  Eigen::VectorXd beginSearch() {
    if (response_.instant()) return loop_->goal();
    response_.effectiveLimits(scene_.arm, lower_, upper_, kTargetAt);
    solver_.limit(lower_, upper_);
    return response_.effectiveAt(loop_->goal(), kTargetAt).cwiseMax(lower_).cwiseMin(upper_);
  }

  /// Goes to where the result's pressures are effective.
  void follow(const TargetSender& sender, const statics::InverseResult& result) {
    Eigen::VectorXd pressure = result.input;
    if (!response_.instant()) response_.inputsFor(scene_.arm, result.input, pressure, kTargetAt);
    if (result.converged() && !command(sender, pressure)) return;
    admission_.accept(sender,
                      {result.status, result.residual, result.position_error, result.limits});
  }

  /// Commands it; else drops the target and returns false.
  bool command(const TargetSender& sender, const Eigen::VectorXd& pressure) {
    const auto refusal = loop_->command(sender.commander, pressure);
    if (refusal) admission_.drop(sender, *refusal);
    return !refusal;
  }

  const io::Scene& scene_;
  const std::string base_frame_;
  const model::ArmResponse& response_;
  std::optional<PressureLoop>& loop_;
  statics::InverseSolver solver_;
  Eigen::VectorXd lower_, upper_;  // of effective pressures
  TargetAdmission admission_;
  control::UnitWatch units_;
  const std::array<ros::Subscriber, 3> subscribers_;
};

constexpr double kReadingShare = 0.9;   // of a turn: a reading is there when the next one begins
constexpr double kLongestGap = 0.4;     // between turns [s]
constexpr double kMissedTurns = 4;      // of a slow loop, before it counts as stopped
constexpr double kLinePatience = 1.25;  // of the line, so that the safety core detects a gap first

/// Longest gap [s] between two turns at this rate [Hz] before the receiver may vent by itself.
double longestGap(double rate) { return std::max(kLongestGap, kMissedTurns / rate); }

/// Starts the scene's regulator with its own I/O. Logs it, and warns of a short supply.
/// @param rate               of the loop that gives the orders [Hz].
/// @param realtime_priority  as IoRules::realtime_priority.
/// @throws std::invalid_argument as requireRegulator(), makeDriver() and RegulatorIo.
std::unique_ptr<regulator::RegulatorIo> startRegulatorIo(const io::Scene& scene, double rate,
                                                         int realtime_priority) {
  const regulator::Config& config = requireRegulator(scene);
  regulator::IoRules rules = regulator::ioRulesOf(scene.safety.rules);
  rules.period = kReadingShare / rate;
  rules.order_timeout = kLinePatience * longestGap(rate);
  rules.realtime_priority = realtime_priority;
  const int channels = scene.arm.actuatorCount();
  logInfo("%s: regulator %s", scene.name.c_str(), regulator::describe(config).c_str());
  auto driver = regulator::makeDriver(config, channels);
  if (std::isfinite(driver->watchdog())) {
    logInfo("%s: by its profile the regulator vents itself if no line comes for %g s; test this",
            scene.name.c_str(), driver->watchdog());
  }
  warnOfShortSupply(scene);
  return std::make_unique<regulator::RegulatorIo>(std::move(driver), channels, rules);
}

/// A guard that vents the scene's regulator if this process is killed.
/// @throws std::runtime_error as regulator::GuardProcess.
std::shared_ptr<regulator::GuardProcess> startGuardProcess(const std::string& scene_path,
                                                           int realtime_priority) {
  const auto program = std::filesystem::read_symlink("/proc/self/exe").parent_path() / "helix_arm";
  return std::make_shared<regulator::GuardProcess>(
      std::vector<std::string>{program.string(), "regulator", scene_path, "guard",
                               "--realtime-priority", std::to_string(realtime_priority)},
      realtime_priority);
}

using Table =
    Eigen::Map<const Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>>;

// Of numbers that a call gives as one array.
Table tableOf(const std::vector<double>& numbers, const char* name, int columns, int most) {
  const auto count = static_cast<Eigen::Index>(numbers.size());
  basics::require(count % columns == 0, name, " has ", count, " numbers; expected rows of ",
                  columns);
  basics::require(count / columns <= most, name, " has ", count / columns,
                  " rows; expected at most ", most, ": call again with the rest");
  return {numbers.data(), count / columns, columns};
}

void requireFinite(const std::vector<double>& table, const char* name) {
  for (std::size_t i = 0; i < table.size(); ++i) {
    basics::require(std::isfinite(table[i]), name, "[", i, "] is ", table[i],
                    "; expected finite numbers");
  }
}

template <class Numbers>
void appendNumbers(const Numbers& numbers, bool found, std::vector<double>& to) {
  for (Eigen::Index i = 0; i < numbers.size(); ++i) {
    to.push_back(found ? numbers.data()[i] : std::numeric_limits<double>::quiet_NaN());
  }
}

// Runs the body, whose exceptions are the answer.
template <class Response, class Body>
bool answer(Response& response, const Body& body) {
  try {
    body();
    response.success = true;
  } catch (const std::exception& fault) {
    response = Response();
    response.message = basics::printableLines(fault.what());
  }
  return true;
}

/// Serves a node's `~forward` and `~inverse`: the model of its scene, for batches.
///
/// Calls are served one after the other in a thread of their own, so that a large batch delays
/// neither targets nor the pressure loop. A call that breaks a rule is answered with the rule.
class ModelServer {
 public:
  static constexpr int kMostForwardRows = 10'000, kMostInverseRows = 1000;

  ModelServer(const ros::NodeHandle& private_node, const statics::ArmModel& model)
      : model_(std::make_shared<statics::ArmModel>(model)),
        node_(onQueue(private_node, queue_)),
        forward_(serve(node_, names::kForward, &ModelServer::onForward, this)),
        inverse_(serve(node_, names::kInverse, &ModelServer::onInverse, this)),
        spinner_(1, &queue_) {
    spinner_.start();
  }

  /// Ends a call that is being served.
  ~ModelServer() {
    ends_ = true;
    forward_.shutdown();
    inverse_.shutdown();
    spinner_.stop();
  }

  /// From now on of this model; calls that are being served end with the one before.
  void adopt(const statics::ArmModel& model) HELIX_ARM_EXCLUDES(mutex_) {
    auto next = std::make_shared<const statics::ArmModel>(model);
    const basics::MutexLock lock(mutex_);
    model_ = std::move(next);
  }

 private:
  bool onForward(const Forward::Request& request, Forward::Response& response) {
    return answer(response, [&] {
      const auto model = this->model();
      const Table pressure =
          tableOf(request.pressure, "pressure", model->arm().actuatorCount(), kMostForwardRows);
      watchUnit("a call to ~forward", model->arm(), pressure);
      response.rows = static_cast<std::uint32_t>(pressure.rows());
      response.sections = static_cast<std::uint32_t>(model->arm().sectionCount());
      for (Eigen::Index row = 0; row < pressure.rows(); ++row) {
        goOn();
        // Pressures outside the limits throw, naming the actuator.
        const statics::Solution found = model->solve(Eigen::VectorXd(pressure.row(row)));
        const bool converged = found.converged();
        response.converged.push_back(converged);
        appendNumbers(found.tip.translation, converged, response.position);
        appendNumbers(lie::quaternionXyzw(found.tip.rotation), converged, response.orientation);
        appendNumbers(found.shape.twists(), converged, response.twist);
      }
    });
  }

  bool onInverse(const Inverse::Request& request, Inverse::Response& response) {
    return answer(response, [&] {
      const auto model = this->model();
      const int n = model->arm().actuatorCount(), starts = request.start.empty() ? 0 : 1;
      const Table position = tableOf(request.position, "position", 3, kMostInverseRows);
      requireFinite(request.position, "position");
      requireFinite(request.start, "start");
      basics::require(request.start.size() == static_cast<std::size_t>(starts * n), "start has ",
                      request.start.size(), " pressures; expected ", n, " or none");
      const Table given(request.start.data(), starts, n);
      watchUnit("start of a call to ~inverse", model->arm(), given);
      statics::InverseOptions options;
      if (!request.prefer.empty()) options.preference = statics::preferenceOf(request.prefer);
      const Eigen::VectorXd start =
          starts == 0 ? model->arm().inputAt(0.0) : Eigen::VectorXd(given.row(0));
      statics::InverseSolver solver(*model, options);
      response.rows = static_cast<std::uint32_t>(position.rows());
      for (Eigen::Index row = 0; row < position.rows(); ++row) {
        goOn();
        const statics::InverseResult& found =
            solver.toPosition(Eigen::Vector3d(position.row(row)), start);
        response.status.emplace_back(inverseWord(found.status));
        appendNumbers(found.input, true, response.pressure);
        response.position_error.push_back(found.position_error);
      }
    });
  }

  std::shared_ptr<const statics::ArmModel> model() const HELIX_ARM_EXCLUDES(mutex_) {
    const basics::MutexLock lock(mutex_);
    return model_;
  }

  /// Warns once of a call whose pressures seem to be in kPa.
  void watchUnit(const std::string& what, const model::Arm& arm, const Table& pressure) {
    if (warned_) return;
    const std::string warning = control::kilopascalWarning(what, arm, pressure);
    if (warning.empty()) return;
    warned_ = true;
    logWarning("%s", warning.c_str());
  }

  /// @throws std::runtime_error once the node ends.
  void goOn() const {
    if (ends_) throw std::runtime_error("the node ends; call again when it runs");
  }

  mutable basics::Mutex mutex_;
  std::shared_ptr<const statics::ArmModel> model_ HELIX_ARM_GUARDED_BY(mutex_);
  std::atomic<bool> ends_{false};
  bool warned_ = false;  // of kilopascals; touched by the thread that serves alone
  ros::CallbackQueue queue_;
  ros::NodeHandle node_;
  ros::ServiceServer forward_, inverse_;
  ros::AsyncSpinner spinner_;
};

/// Drives the arm of a scene to target pressures, shapes and tips, through the scene's regulator
/// (real or simulated) or another node's. docs/nodes.md lists its topics, services and parameters
/// (PressureCommandOptions); docs/safety.md tells who commands and when the arm vents.
///
/// Between targets and regulator stands control::SafetyCore: any fault vents the arm, and nothing
/// moves until it is enabled again. All times are of a steady clock, so that a paused or simulated
/// clock neither stops the loop nor keeps a lease.
///
/// The arm vents in every case when the node ends: in an orderly end by this node; if it is killed
/// or stopped, by a guard process (hardware), or by the regulator's node when the commands stop.
///
/// Its parts: TargetIntake accepts targets, PressureLoop drives the regulator, ShapePublisher shows
/// the arm at the readings. All of them but PressureLoop and ModelServer run in the main thread
/// only, so that no shape, target or reload delays the loop.
class PressureCommandNode : public Node {
 public:
  PressureCommandNode()
      : shapes_(node_, scene_, options_,
                [this](const TipTarget& target) { intake_.takeFromHandle(target); }),
        intake_(node_, scene_, shapes_.baseFrame(), shapes_.response(), loop_),
        model_server_(ros::NodeHandle("~"), scene_.model) {
    reload_ =
        std::make_unique<ReloadServer>(ros::NodeHandle("~"), options_.scene, options_.scene_folder,
                                       [this](io::Scene next) { adopt(std::move(next)); });

    const bool own = options_.regulator == "scene";
    const bool hardware = own && regulator::isHardware(requireRegulator(scene_));
    if (hardware) {
      refuseSimulatedTime();
      guard_ = startGuardProcess(options_.scene, options_.realtime_priority);
    }
    tellRealtime(hardware);
    std::unique_ptr<regulator::RegulatorIo> io;
    try {
      if (own) io = startRegulatorIo(scene_, options_.rate, options_.realtime_priority);
    } catch (...) {
      if (guard_) guard_->dismiss();  // nothing was connected
      throw;
    }
    regulator::PressurePath path({scene_.safety.channels, scene_.safety.rules}, std::move(io),
                                 longestGap(options_.rate));
    path.guardedBy(guard_);
    loop_.emplace(
        node_, scene_.arm, options_.rate, options_.realtime_priority, std::move(path),
        options_.auto_enable && scene_.regulator && !regulator::isHardware(*scene_.regulator),
        [this](const PressureLoop::Reading& reading) {
          shapes_.take(reading.pressure, reading.stamp);
        });
    using Self = PressureCommandNode;
    draw_timer_ = repeat(node_, "the drawing", 1.0 / options_.draw_rate, &Self::onDraw, this);
    diagnose_timer_ = repeat(node_, "the diagnostics", 1.0, &Self::onDiagnose, this);
    logInfo("%s: %d actuators in %d sections, loop at %g Hz", scene_.name.c_str(),
            scene_.arm.actuatorCount(), scene_.arm.sectionCount(), options_.rate);
    tellTier();
  }

  ~PressureCommandNode() override { finish(); }

  /// Vents, and returns afterwards.
  int finish() override {
    const bool vented = loop_->end();
    if (guard_ && vented) guard_->dismiss();
    return loop_->verdict();
  }

 private:
  void refuseSimulatedTime() const {
    if (!ros::Time::isSimTime()) return;
    basics::require(options_.allow_sim_time, "/use_sim_time is true, but scene ", scene_.name,
                    " drives hardware; end the recording or simulation that sets it, or set "
                    "~allow_sim_time to true if that is intended");
    logWarning("%s: drives hardware under simulated time (~allow_sim_time)", scene_.name.c_str());
  }

  // Real-time priority is optional; without it, only a busy machine is affected.
  void tellRealtime(bool hardware) const {
    const int priority = options_.realtime_priority;
    if (priority == 0) return;
    const auto tell = [hardware](const std::string& refusal, const char* success) {
      if (refusal.empty()) return logInfo("%s", success);
      logLine(hardware ? ros::console::levels::Warn : ros::console::levels::Info,
              "%s; without it other programs may delay a vent", refusal.c_str());
    };
    tell(regulator::tryRealtime(priority), "the pressure loop has real-time priority");
    if (hardware) tell(regulator::lockMemory(), "the node's memory is locked");
  }

  void tellTier() const {
    const statics::TierChoice& choice = scene_.model.choice();
    logInfo("%s: tier %s: %s", scene_.name.c_str(), choice.setting.name().c_str(),
            choice.reason.c_str());
  }

  // Each new error of the line once.
  void tellLineError(const regulator::IoStatus& line) {
    if (line.last_error.empty() || line.last_error == told_line_error_) return;
    told_line_error_ = line.last_error;
    logWarning("regulator: %s", line.last_error.c_str());
  }

  void requireSameRegulator(const io::Scene& next) const {
    const auto describe = [](const io::Scene& scene) {
      if (!scene.regulator) return std::string("none");
      const std::string channels = regulator::describeChannels(*scene.regulator);
      return regulator::describe(*scene.regulator) + (channels.empty() ? "" : ", " + channels);
    };
    basics::require(describe(scene_) == describe(next), "scene ", next.name,
                    " has another regulator: ", describe(next), ", expected ", describe(scene_),
                    "; restart the nodes to change it");
    if (!guard_) return;
    const std::string looser = control::loosened(first_safety_.channels, first_safety_.rules,
                                                 next.safety.channels, next.safety.rules);
    basics::require(looser.empty(), "scene ", next.name,
                    " is less safe than the one that this node started with: ", looser,
                    "; restart the nodes to change that");
  }

  void adopt(io::Scene next) {
    next = requirePneumatic(std::move(next));
    requireSameRig(scene_, next);
    requireSameRegulator(next);
    watched_.requireFree();
    loop_->adopt(next.arm, next.safety.channels, next.safety.rules);
    scene_ = std::move(next);
    intake_.adopt();
    model_server_.adopt(scene_.model);
    tellTier();
    shapes_.adopt();
  }

  void onDraw(const ros::SteadyTimerEvent&) {
    if (options_.handle) shapes_.moveHandle(loop_->goal());
    const PressureLoop::Snapshot path = loop_->snapshot();
    shapes_.draw(path.report, path.reason);
  }

  /// WARN if the loop was slower than wanted since the last call.
  DiagnosticStatus loopStatus(const PressureLoop::Snapshot& path) {
    const ros::SteadyTime now = ros::SteadyTime::now();
    const auto turns = static_cast<double>(path.turns - std::exchange(told_turns_, path.turns));
    const double rate = turns / (now - std::exchange(last_diagnostics_, now)).toSec();
    const bool slow = rate < kSlowShare * options_.rate;
    return makeStatus(names::kLoopStatus, slow ? DiagnosticStatus::WARN : DiagnosticStatus::OK,
                      slow ? "the loop is slower than ~rate" : "the loop keeps its rate",
                      {{"rate_hz", fixed(rate)},
                       {"wanted_rate_hz", fixed(options_.rate)},
                       {"bad_readings", std::to_string(path.bad_readings.total())}});
  }

  void onDiagnose(const ros::SteadyTimerEvent&) {
    const PressureLoop::Snapshot path = loop_->snapshot();
    DiagnosticStatus loop = loopStatus(path);
    shapes_.reportSilence(loop);
    std::vector<DiagnosticStatus> statuses = {intake_.status(), std::move(loop), shapes_.status(),
                                              safetyStatus(scene_, path)};
    if (path.io) {
      tellLineError(*path.io);
      statuses.push_back(regulatorStatus(scene_, *path.io));
    }
    for (int i = 0; i < scene_.arm.actuatorCount(); ++i) {
      statuses.push_back(channelStatus(scene_, path, i));
    }
    if (guard_ && control::isGone(guard_->state())) replaceGuard();
    diagnostics_.publish(ros::this_node::getName(), scene_, std::move(statuses));
    const std::string units = intake_.unitWarning();
    if (!units.empty()) logWarning("%s", units.c_str());
  }

  void replaceGuard() {
    const bool tell = guard_losses_.add();
    if (tell) {
      logError(
          "the guard, which vents the arm if this node is killed, has ended or does not respond "
          "(%lu times so far): the arm vents, and another guard is started",
          guard_losses_.total());
    }
    guard_->dismiss();  // if it resumes, it must not vent an arm that the next one guards
    try {
      auto next = startGuardProcess(options_.scene, options_.realtime_priority);
      loop_->guardedBy(next);
      guard_ = std::move(next);
    } catch (const std::runtime_error& error) {
      if (tell) logError("%s; the arm stays vented until one is started", error.what());
    }
  }

  const PressureCommandOptions options_{};
  io::Scene scene_ = requirePneumatic(io::loadScene(options_.scene));
  /// Rules that no reloaded file may loosen, with hardware.
  const io::SafetyConfig first_safety_ = scene_.safety;
  std::string told_line_error_;
  std::uint64_t told_turns_ = 0;  ///< of the loop, at the last diagnostics
  ros::SteadyTime last_diagnostics_ = ros::SteadyTime::now();
  FaultCount guard_losses_;

  ros::NodeHandle node_;
  DiagnosticsPublisher diagnostics_{node_};
  const LoopWatch watched_{node_};
  ShapePublisher shapes_;
  TargetIntake intake_;
  std::unique_ptr<ReloadServer> reload_;
  ModelServer model_server_;
  ros::SteadyTimer draw_timer_, diagnose_timer_;
  std::shared_ptr<regulator::GuardProcess> guard_;  ///< of hardware
  std::optional<PressureLoop> loop_;  ///< last, since its readings go to all of the above
};

}  // namespace

std::unique_ptr<Node> makePressureCommand() { return std::make_unique<PressureCommandNode>(); }

}  // namespace helix_arm::ros_bridge
