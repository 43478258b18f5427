#include "pressure_command_node.hpp"

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <stdexcept>
#include <utility>
#include <vector>

#include <ros/this_node.h>

#include "helix_arm/basics/requirement.hpp"
#include "helix_arm/regulator/config.hpp"
#include "regulator/realtime.hpp"
#include "ros_bridge/common/guarded_callbacks.hpp"
#include "ros_bridge/names.hpp"

namespace helix_arm::ros_bridge {
namespace {

using diagnostic_msgs::DiagnosticStatus;

constexpr double kSlowShare = 0.9;      // of ~rate; a slower loop is worth a warning
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

// By control::Valve.
constexpr const char* kValves[] = {"vent", "regulate", "close"};

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

}  // namespace

PressureCommandNode::PressureCommandNode()
    : shapes_(node_, scene_, options_,
              [this](const TipTarget& target) { intake_.admission().takeFromHandle(target); }),
      gate_(node_, scene_, shapes_.baseFrame(), 1.0 / options_.draw_rate, shapes_.response(),
            [this] { loop_.hold(); }),
      loop_(
          node_, scene_.arm, options_.rate, options_.realtime_priority, startPath(),
          options_.auto_enable && scene_.regulator && !regulator::isHardware(*scene_.regulator),
          [this](const PressureLoop& loop, const Eigen::VectorXd& target) {
            return gate_.refusalOf(loop, target);
          },
          [this](const PressureLoop::Reading& reading) {
            shapes_.take(reading.pressure, reading.set_point, reading.stamp);
          }),
      intake_(node_, scene_, shapes_.baseFrame(), shapes_.response(), loop_, gate_),
      model_server_(ros::NodeHandle("~"), scene_.model),
      plan_server_(ros::NodeHandle("~"), scene_, shapes_.baseFrame(), loop_),
      reload_(ros::NodeHandle("~"), options_.scene, options_.scene_folder,
              [this](io::Scene next) { adopt(std::move(next)); }) {
  draw_timer_ = repeat(node_, "the drawing", 1.0 / options_.draw_rate, [this] { draw(); });
  diagnose_timer_ = repeat(node_, "the diagnostics", 1.0, [this] { diagnose(); });
  logInfo("%s: %d actuators in %d sections, loop at %g Hz", scene_.name.c_str(),
          scene_.arm.actuatorCount(), scene_.arm.sectionCount(), options_.rate);
  tellTier();
}

int PressureCommandNode::finish() {
  const bool vented = loop_.end();
  if (guard_ && vented) guard_->dismiss();
  return loop_.verdict();
}

regulator::PressurePath PressureCommandNode::startPath() {
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
  return path;
}

void PressureCommandNode::refuseSimulatedTime() const {
  if (!ros::Time::isSimTime()) return;
  basics::require(options_.allow_sim_time, "/use_sim_time is true, but scene ", scene_.name,
                  " drives hardware; end the recording or simulation that sets it, or set "
                  "~allow_sim_time to true if that is intended");
  logWarning("%s: drives hardware under simulated time (~allow_sim_time)", scene_.name.c_str());
}

void PressureCommandNode::tellRealtime(bool hardware) const {
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

void PressureCommandNode::tellTier() const {
  const statics::TierChoice& choice = scene_.model.choice();
  logInfo("%s: tier %s: %s", scene_.name.c_str(), choice.setting.name().c_str(),
          choice.reason.c_str());
}

void PressureCommandNode::tellLineError(const regulator::IoStatus& line) {
  if (line.last_error.empty() || line.last_error == told_line_error_) return;
  told_line_error_ = line.last_error;
  logWarning("regulator: %s", line.last_error.c_str());
}

void PressureCommandNode::requireSameRegulator(const io::Scene& next) const {
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

void PressureCommandNode::adopt(io::Scene next) {
  next = requirePneumatic(std::move(next));
  requireSameRig(scene_, next);
  requireSameRegulator(next);
  watched_.requireFree();
  loop_.adopt(next.arm, next.safety.channels, next.safety.rules);
  scene_ = std::move(next);
  gate_.adopt();
  intake_.adopt();
  model_server_.adopt(scene_.model);
  plan_server_.adopt(scene_);
  tellTier();
  shapes_.adopt();
}

void PressureCommandNode::replaceGuard() {
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
    loop_.guardedBy(next);
    guard_ = std::move(next);
  } catch (const std::runtime_error& error) {
    if (tell) logError("%s; the arm stays vented until one is started", error.what());
  }
}

void PressureCommandNode::draw() {
  if (options_.handle) shapes_.moveHandle(loop_.goal());
  const PressureLoop::Snapshot path = loop_.snapshot();
  shapes_.draw(path.report, path.reason);
  gate_.draw(shapes_.drawn());
}

void PressureCommandNode::diagnose() {
  const PressureLoop::Snapshot path = loop_.snapshot();
  DiagnosticStatus loop = loopStatus(path);
  shapes_.reportSilence(loop);
  std::vector<DiagnosticStatus> statuses = {intake_.admission().status(), std::move(loop),
                                            shapes_.status(), safetyStatus(scene_, path)};
  if (path.io) {
    statuses.push_back(regulatorStatus(scene_, *path.io));
    tellLineError(*path.io);
  }
  for (int i = 0; i < scene_.arm.actuatorCount(); ++i) {
    statuses.push_back(channelStatus(scene_, path, i));
  }
  if (guard_ && control::isGone(guard_->state())) replaceGuard();
  diagnostics_.publish(ros::this_node::getName(), scene_, std::move(statuses));
  const std::string units = intake_.unitWarning();
  if (!units.empty()) logWarning("%s", units.c_str());
}

DiagnosticStatus PressureCommandNode::loopStatus(const PressureLoop::Snapshot& path) {
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

std::unique_ptr<Node> makePressureCommand() { return std::make_unique<PressureCommandNode>(); }

}  // namespace helix_arm::ros_bridge
