#include <Eigen/Geometry>
#include <cmath>
#include <limits>

#include <diagnostic_msgs/DiagnosticArray.h>
#include <ros/spinner.h>
#include <ros/this_node.h>

#include "helix_arm/Forward.h"
#include "helix_arm/Inverse.h"
#include "helix_arm/basics/mutex.hpp"
#include "helix_arm/basics/quote.hpp"
#include "helix_arm/basics/requirement.hpp"
#include "helix_arm/control/safety.hpp"
#include "helix_arm/control/target_check.hpp"
#include "helix_arm/io/scene.hpp"
#include "helix_arm/lie/so3.hpp"
#include "helix_arm/regulator/config.hpp"
#include "helix_arm/regulator/guard_process.hpp"
#include "helix_arm/regulator/realtime.hpp"
#include "helix_arm/statics/arm_model.hpp"
#include "helix_arm/statics/inverse.hpp"
#include "pressure_loop.hpp"
#include "regulator_setup.hpp"
#include "ros_bridge/common/conversions.hpp"
#include "ros_bridge/common/diagnostics.hpp"
#include "ros_bridge/common/file_access.hpp"
#include "ros_bridge/common/guarded_callbacks.hpp"
#include "ros_bridge/common/log.hpp"
#include "ros_bridge/common/parameters.hpp"
#include "ros_bridge/common/reload_server.hpp"
#include "ros_bridge/common/run_node.hpp"
#include "ros_bridge/names.hpp"
#include "shape_publisher.hpp"
#include "target_intake.hpp"

namespace helix_arm::ros_bridge {

PressureCommandOptions PressureCommandOptions::load() {
  ParameterReader reader{ros::NodeHandle("~")};
  PressureCommandOptions out;
  out.scene = reader.file("scene", "config/scenes", ".yaml");
  out.rate = reader.number("rate", out.rate, {1.0, 1000.0});
  out.tf_rate = std::min(out.rate, reader.number("tf_rate", out.tf_rate, {0.1, 1000.0}));
  out.draw_rate = reader.number("draw_rate", out.draw_rate, {0.1, 100.0});
  out.frames = reader.count("frames", out.frames, 2, 1000);
  out.world_frame = reader.frame("world_frame", names::kWorldFrame);
  out.frame_prefix = reader.frame("frame_prefix", "");
  out.handle = reader.flag("handle", out.handle);
  out.regulator = reader.choice("regulator", out.regulator, {"scene", "topic"});
  out.auto_enable = reader.flag("auto_enable", out.regulator == "scene");
  out.allow_sim_time = reader.flag("allow_sim_time", out.allow_sim_time);
  out.realtime_priority = reader.count("realtime_priority", out.realtime_priority, 0,
                                       regulator::kHighestRealtimePriority);
  out.scene_folder = reader.folder("scene_folder", defaultFolder());
  reader.finish();
  return out;
}

namespace {

using control::SafetyCause;
using control::SafetyState;
using diagnostic_msgs::DiagnosticStatus;

constexpr double kSlowShare = 0.9;  // of ~rate; a slower loop is worth a warning

const char* textOf(control::Valve valve) {
  switch (valve) {
    case control::Valve::kRegulate:
      return "regulate";
    case control::Valve::kClose:
      return "close";
    case control::Valve::kVent:
      return "vent";
  }
  return "";
}

unsigned char diagnosticLevel(const control::SafetyReport& report) {
  if (report.vent_overdue) return DiagnosticStatus::ERROR;
  if (report.cause == SafetyCause::kNone) return DiagnosticStatus::OK;
  if (report.cause == SafetyCause::kVentRequested) return DiagnosticStatus::WARN;
  return report.state == SafetyState::kEnabled ? DiagnosticStatus::OK : DiagnosticStatus::ERROR;
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
  const char* const valve = textOf(path.orders.valve[static_cast<std::size_t>(channel)]);
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

constexpr double kNoNumber = std::numeric_limits<double>::quiet_NaN();

// Number of rows of a table that a call gives as one array.
std::size_t rowsOf(const std::vector<double>& table, const char* name, std::size_t columns,
                   std::size_t most) {
  basics::require(table.size() % columns == 0, name, " has ", table.size(),
                  " numbers; expected rows of ", columns);
  const std::size_t rows = table.size() / columns;
  basics::require(rows <= most, name, " has ", rows, " rows; expected at most ", most,
                  ": call again with the rest");
  return rows;
}

void requireFinite(const std::vector<double>& table, const char* name) {
  for (std::size_t i = 0; i < table.size(); ++i) {
    basics::require(std::isfinite(table[i]), name, "[", i, "] is ", table[i],
                    "; expected finite numbers");
  }
}

Eigen::VectorXd rowOf(const std::vector<double>& table, std::size_t row, std::size_t columns) {
  return Eigen::VectorXd::Map(table.data() + row * columns, static_cast<Eigen::Index>(columns));
}

template <class Numbers>
void appendNumbers(const Numbers& numbers, bool found, std::vector<double>& to) {
  for (Eigen::Index i = 0; i < numbers.size(); ++i) {
    to.push_back(found ? numbers.data()[i] : kNoNumber);
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

ros::NodeHandle onQueue(ros::NodeHandle node, ros::CallbackQueue& queue) {
  node.setCallbackQueue(&queue);
  return node;
}

/// Serves a node's `~forward` and `~inverse`: the model of its scene, for batches.
///
/// Calls are served one after the other in a thread of their own, so that a large batch delays
/// neither targets nor the pressure loop. A call that breaks a rule is answered with the rule.
class ModelServer {
 public:
  static constexpr std::size_t kMostForwardRows = 10'000;
  static constexpr std::size_t kMostInverseRows = 1000;

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
  bool onForward(Forward::Request& request, Forward::Response& response) {
    return answer(response, [&] {
      const auto model = this->model();
      const auto n = static_cast<std::size_t>(model->arm().actuatorCount());
      const std::size_t rows = rowsOf(request.pressure, "pressure", n, kMostForwardRows);
      watchUnit("a call to ~forward", model->arm(), request.pressure);
      response.rows = static_cast<std::uint32_t>(rows);
      response.sections = static_cast<std::uint32_t>(model->arm().sectionCount());
      for (std::size_t row = 0; row < rows; ++row) {
        goOn();
        // Pressures outside the limits throw, naming the actuator.
        const statics::Solution found = model->solve(rowOf(request.pressure, row, n));
        const bool converged = found.converged();
        response.converged.push_back(converged);
        appendNumbers(found.tip.translation, converged, response.position);
        appendNumbers(lie::quaternionXyzw(found.tip.rotation), converged, response.orientation);
        appendNumbers(found.shape.twists(), converged, response.twist);
      }
    });
  }

  bool onInverse(Inverse::Request& request, Inverse::Response& response) {
    return answer(response, [&] {
      const auto model = this->model();
      const auto n = static_cast<std::size_t>(model->arm().actuatorCount());
      const std::size_t rows = rowsOf(request.position, "position", 3, kMostInverseRows);
      requireFinite(request.position, "position");
      requireFinite(request.start, "start");
      basics::require(request.start.empty() || request.start.size() == n, "start has ",
                      request.start.size(), " pressures; expected ", n, " or none");
      watchUnit("start of a call to ~inverse", model->arm(), request.start);
      statics::InverseOptions options;
      if (!request.prefer.empty()) options.preference = statics::preferenceOf(request.prefer);
      const Eigen::VectorXd start =
          request.start.empty() ? model->arm().inputAt(0.0) : rowOf(request.start, 0, n);
      statics::InverseSolver solver(*model, options);
      response.rows = static_cast<std::uint32_t>(rows);
      for (std::size_t row = 0; row < rows; ++row) {
        goOn();
        const statics::InverseResult& found =
            solver.toPosition(rowOf(request.position, row, 3), start);
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
  void watchUnit(const std::string& what, const model::Arm& arm, const std::vector<double>& rows) {
    if (warned_) return;
    using RowMajor = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
    const Eigen::Index n = arm.actuatorCount();
    const std::string warning = control::kilopascalWarning(
        what, arm, RowMajor::Map(rows.data(), static_cast<Eigen::Index>(rows.size()) / n, n));
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
/// (real or simulated) or another node's.
///
/// Between targets and regulator stands control::SafetyCore: any fault vents the arm, and nothing
/// moves until it is enabled again.
///
/// Subscribes
/// - pressure_target (PressureArray): gauge [Pa]; omitted names keep their command
/// - shape_target (ShapeTarget): twists of all sections
/// - tip_target (TipTarget): position or pose of the tip, base frame
/// - tip_handle/feedback (visualization_msgs/InteractiveMarkerFeedback)
/// - pressure_measured (PressureArray): with ~regulator `topic`; gauge [Pa], all actuators
///
/// Publishes
/// - pressure_command (PressureArray): command in force [Pa], moving to the target at most at the
///   scene's slew rate, 0 while the arm is not enabled; immediately on a target, and with every
///   loop
/// - pressure_measured (PressureArray): with ~regulator `scene`, as the regulator reads them [Pa]
/// - safety_state (SafetyState): latched, on every change
/// - model (ArmShape): with every pressure_measured, or only the last if the tier is slower than
///   these, the model's shape at the measured pressures clamped to the limits, under the scene's
///   load, with the stamp of that pressure_measured. The pressures are known only from this
///   measurement, also on hardware.
/// - target_status (TargetStatus): result of each target
/// - markers (visualization_msgs/MarkerArray); tip_handle/update and tip_handle/update_full
/// - /diagnostics (diagnostic_msgs/DiagnosticArray): `<node>: targets`, `<node>: loop`,
///   `<node>: model` (its tier, and whether it finds a shape), `<node>: safety`,
///   `<node>: regulator` and one `<node>: channel <actuator>` each, 1 Hz
/// - tf: world -> arm_base (static), arm_base -> model_0 .. model_(n-1) and model_tip
///
/// Services
/// - ~enable, ~rest, ~vent (std_srvs/Trigger), ~emergency_stop (std_srvs/SetBool, latched while
///   true): their answers give the result and the reason
/// - ~reload (Reload): another file of the same rig and regulator. The command stays, and must be
///   inside the new limits; with hardware, no rule may be looser than when the node started.
/// - ~forward (Forward), ~inverse (Inverse): the model, for batches; in a thread of their own
///
/// Parameters: PressureCommandOptions.
///
/// A bad target is dropped: it is counted, warned of once per fault and five seconds, and answered
/// on target_status; the command stays. A target out of reach moves the arm to the closest
/// reachable. A target while the arm is not enabled is dropped with the reason. Of several
/// publishers the first one commands, until it has been silent for the scene's
/// safety.commander_timeout. All times are of a steady clock, so that a paused or simulated clock
/// neither stops the loop nor keeps a lease; the loop has its own thread, which no shape, target or
/// reload delays. Without fresh measurements, or if the model finds no shape that balances the
/// load, there is neither model nor drawing, and the diagnostics say so.
///
/// The arm vents in every case when the node ends: in an orderly end by this node; if it is killed
/// or stopped, by a guard process (hardware), or by the regulator's node when the commands stop.
/// Ends with 0 if asked to, 1 if the ROS master is lost, 2 on a bad scene or parameter, such as
/// simulated time with hardware.
///
/// Its parts: TargetIntake accepts targets, PressureLoop drives the regulator, ShapePublisher shows
/// the arm at the readings. All of them but PressureLoop and
/// ModelServer run in the main thread only.
class PressureCommandNode : public Node {
 public:
  PressureCommandNode()
      : shapes_(node_, scene_, options_,
                [this](const TipTarget& target) { intake_.takeFromHandle(target); }),
        intake_(node_, scene_, shapes_.baseFrame(), shapes_.response(),
                {[this] { return loop_->goal(); },
                 [this](const std::string& commander, const Eigen::VectorXd& pressure) {
                   return loop_->command(commander, pressure);
                 }}),
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
    if (!options_.allow_sim_time) {
      throw ParameterError("/use_sim_time is true, but scene " + scene_.name +
                           " drives hardware; end the recording or simulation that sets it, or set "
                           "~allow_sim_time to true if that is intended");
    }
    logWarning("%s: drives hardware under simulated time (~allow_sim_time)", scene_.name.c_str());
  }

  // Real-time priority is optional; without it, only a busy machine is affected.
  void tellRealtime(bool hardware) const {
    const int priority = options_.realtime_priority;
    if (priority == 0) return;
    const auto tell = [hardware](const std::string& refusal, const char* success) {
      if (refusal.empty()) {
        logInfo("%s", success);
      } else {
        logLine(hardware ? ros::console::levels::Warn : ros::console::levels::Info,
                "%s; without it other programs may delay a vent", refusal.c_str());
      }
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
    if (describe(scene_) != describe(next)) {
      throw std::invalid_argument("scene " + next.name +
                                  " has another regulator: " + describe(next) + ", expected " +
                                  describe(scene_) + "; restart the nodes to change it");
    }
    if (!guard_) return;
    const std::string looser = control::loosened(first_safety_.channels, first_safety_.rules,
                                                 next.safety.channels, next.safety.rules);
    if (!looser.empty()) {
      throw std::invalid_argument("scene " + next.name +
                                  " is less safe than the one that this node started with: " +
                                  looser + "; restart the nodes to change that");
    }
  }

  void adopt(io::Scene next) {
    next = requirePneumatic(std::move(next));
    requireSameRig(scene_, next);
    requireSameRegulator(next);
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
    shapes_.tell(path.report, path.reason);
    shapes_.draw();
  }

  /// WARN if the loop was slower than wanted since the last call.
  DiagnosticStatus loopStatus(const PressureLoop::Snapshot& path) {
    const ros::SteadyTime now = ros::SteadyTime::now();
    const auto turns = static_cast<double>(path.turns - std::exchange(told_turns_, path.turns));
    const double rate = turns / (now - std::exchange(last_diagnostics_, now)).toSec();
    const bool slow = rate < kSlowShare * options_.rate;
    return makeStatus(names::kLoopStatus, slow ? DiagnosticStatus::WARN : DiagnosticStatus::OK,
                      slow ? "the loop is slower than ~rate" : "the loop keeps its rate",
                      {{names::kRateKey, fixed(rate)},
                       {names::kWantedRateKey, fixed(options_.rate)},
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
    diagnostics_.publish(ros::this_node::getName(), scene_.name, std::move(statuses));
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

  const PressureCommandOptions options_ = PressureCommandOptions::load();
  io::Scene scene_ = requirePneumatic(io::loadScene(options_.scene));
  /// Rules that no reloaded file may loosen, with hardware.
  const io::SafetyConfig first_safety_ = scene_.safety;
  std::string told_line_error_;
  std::uint64_t told_turns_ = 0;  ///< of the loop, at the last diagnostics
  ros::SteadyTime last_diagnostics_ = ros::SteadyTime::now();
  FaultCount guard_losses_;

  ros::NodeHandle node_;
  DiagnosticsPublisher diagnostics_{node_};
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
