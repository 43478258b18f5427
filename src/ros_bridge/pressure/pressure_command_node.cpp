#include "ros_bridge/pressure/pressure_command_node.hpp"

#include <stdexcept>
#include <utility>

#include <diagnostic_msgs/DiagnosticArray.h>
#include <ros/this_node.h>

#include "helix_arm/control/safety.hpp"
#include "helix_arm/regulator/config.hpp"
#include "helix_arm/regulator/realtime.hpp"
#include "ros_bridge/common/guarded_callbacks.hpp"
#include "ros_bridge/common/log.hpp"
#include "ros_bridge/common/names.hpp"
#include "ros_bridge/common/parameters.hpp"
#include "ros_bridge/common/pneumatics.hpp"
#include "ros_bridge/pressure/regulator_setup.hpp"

namespace helix_arm::ros_bridge {

PressureCommandNode::PressureCommandNode()
    : options_(PressureCommandOptions::load()),
      scene_(requirePneumatic(io::loadScene(options_.scene))),
      first_safety_(scene_.safety),
      loop_rate_(options_.rate),
      diagnostics_publisher_(
          node_.advertise<diagnostic_msgs::DiagnosticArray>(names::kDiagnostics, 10)),
      shapes_(node_, scene_, options_,
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
  using Node = PressureCommandNode;
  draw_timer_ = repeat(node_, "the drawing", 1.0 / options_.draw_rate, &Node::onDraw, this);
  diagnose_timer_ = repeat(node_, "the diagnostics", 1.0, &Node::onDiagnose, this);
  logInfo("%s: %d actuators in %d sections, loop at %g Hz", scene_.name.c_str(),
          scene_.arm.actuatorCount(), scene_.arm.sectionCount(), options_.rate);
  tellTier();
}

PressureCommandNode::~PressureCommandNode() { finish(); }

int PressureCommandNode::finish() {
  const bool vented = loop_->end();
  if (guard_ && vented) guard_->dismiss();
  return loop_->verdict();
}

void PressureCommandNode::refuseSimulatedTime() const {
  if (!ros::Time::isSimTime()) return;
  if (!options_.allow_sim_time) {
    throw ParameterError("/use_sim_time is true, but scene " + scene_.name +
                         " drives hardware; end the recording or simulation that sets it, or set "
                         "~allow_sim_time to true if that is intended");
  }
  logWarning("%s: drives hardware under simulated time (~allow_sim_time)", scene_.name.c_str());
}

// Real-time priority is optional; without it, only a busy machine is affected.
void PressureCommandNode::tellRealtime(bool hardware) const {
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

void PressureCommandNode::tellTier() const {
  const statics::TierChoice& choice = scene_.model.choice();
  logInfo("%s: tier %s: %s", scene_.name.c_str(), choice.setting.name().c_str(),
          choice.reason.c_str());
}

void PressureCommandNode::requireSameRegulator(const io::Scene& next) const {
  const auto describe = [](const io::Scene& scene) {
    if (!scene.regulator) return std::string("none");
    const std::string channels = regulator::describeChannels(*scene.regulator);
    return regulator::describe(*scene.regulator) + (channels.empty() ? "" : ", " + channels);
  };
  if (describe(scene_) != describe(next)) {
    throw std::invalid_argument("scene " + next.name + " has another regulator: " + describe(next) +
                                ", expected " + describe(scene_) +
                                "; restart the nodes to change it");
  }
  if (!guard_) return;
  const std::string looser = control::loosened(first_safety_.channels, first_safety_.rules,
                                               next.safety.channels, next.safety.rules);
  if (!looser.empty()) {
    throw std::invalid_argument(
        "scene " + next.name + " is less safe than the one that this node started with: " + looser +
        "; restart the nodes to change that");
  }
}

void PressureCommandNode::adopt(io::Scene next) {
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

// Each new error of the line once.
void PressureCommandNode::tellLineError(const regulator::IoStatus& line) {
  if (line.last_error.empty() || line.last_error == told_line_error_) return;
  told_line_error_ = line.last_error;
  logWarning("regulator: %s", line.last_error.c_str());
}

void PressureCommandNode::onDraw(const ros::SteadyTimerEvent&) {
  if (options_.handle) shapes_.moveHandle(loop_->goal());
  const PressureLoop::Snapshot path = loop_->snapshot();
  shapes_.tell(path.report, path.reason);
  shapes_.draw();
}

void PressureCommandNode::onDiagnose(const ros::SteadyTimerEvent&) {
  using diagnostic_msgs::DiagnosticStatus;
  const ros::SteadyTime now = ros::SteadyTime::now();
  const PressureLoop::Snapshot path = loop_->snapshot();
  const std::string& node = ros::this_node::getName();

  diagnostic_msgs::DiagnosticArray msg;
  msg.header.stamp = ros::Time::now();
  DiagnosticStatus loop = loop_rate_.status(node, path, now);
  shapes_.reportSilence(loop);
  msg.status = {intake_.status(node), std::move(loop), shapes_.status(node)};
  if (path.io) tellLineError(*path.io);
  for (DiagnosticStatus& status : pressureStatuses(node, scene_, path)) {
    msg.status.push_back(std::move(status));
  }
  if (guard_ && control::isGone(guard_->state())) replaceGuard();
  for (DiagnosticStatus& status : msg.status) status.hardware_id = scene_.name;
  diagnostics_publisher_.publish(msg);
  const std::string units = intake_.unitWarning();
  if (!units.empty()) logWarning("%s", units.c_str());
}

void PressureCommandNode::replaceGuard() {
  const bool tell = guard_losses_.add();
  if (tell) {
    logError(
        "the guard, which vents the arm if this node is killed, has ended or does not respond (%lu "
        "times so far): the arm vents, and another guard is started",
        static_cast<unsigned long>(guard_losses_.total()));
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

}  // namespace helix_arm::ros_bridge
