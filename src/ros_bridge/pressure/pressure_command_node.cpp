#include "helix_arm/ros_bridge/pressure/pressure_command_node.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <sstream>
#include <stdexcept>
#include <utility>

#include <diagnostic_msgs/DiagnosticArray.h>
#include <ros/console.h>
#include <ros/this_node.h>

#include "helix_arm/basics/quote.hpp"
#include "helix_arm/model/curve.hpp"
#include "helix_arm/regulator/config.hpp"
#include "helix_arm/regulator/realtime.hpp"
#include "helix_arm/ros_bridge/common/diagnostics.hpp"
#include "helix_arm/ros_bridge/common/file_access.hpp"
#include "helix_arm/ros_bridge/common/guarded_callbacks.hpp"
#include "helix_arm/ros_bridge/common/model_history.hpp"
#include "helix_arm/ros_bridge/common/names.hpp"
#include "helix_arm/ros_bridge/common/parameters.hpp"
#include "helix_arm/ros_bridge/common/pneumatics.hpp"
#include "helix_arm/ros_bridge/pressure/pressure_diagnostics.hpp"
#include "helix_arm/ros_bridge/pressure/regulator_setup.hpp"

namespace helix_arm::ros_bridge {
namespace {

constexpr double kFresh = 1.0;      // a regulator silent for longer is worth an error [s]
constexpr double kSlowShare = 0.9;  // of the wanted rate; a loop below it is worth a warning

}  // namespace

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

PressureCommandNode::PressureCommandNode()
    : options_(PressureCommandOptions::load()),
      scene_(requirePneumatic(io::loadScene(options_.scene))),
      first_safety_(scene_.safety),
      frames_(options_.world_frame, options_.frame_prefix, names::kModelFrames, options_.frames),
      solver_(scene_.model),
      lease_(scene_.safety.commander_timeout),
      markers_(scene_, frames_.base, std::max(1.0, 3.0 / options_.draw_rate)),
      measured_(scene_.arm.inputAt(0)),
      solution_(scene_.model.solve(measured_)),
      last_diagnosis_(ros::SteadyTime::now()) {
  model_publisher_ = node_.advertise<ArmShape>(names::kModel, 10);
  status_publisher_ = node_.advertise<TargetStatus>(names::kTargetStatus, 100);
  marker_publisher_ = node_.advertise<visualization_msgs::MarkerArray>(names::kMarkers, 2);
  diagnostics_publisher_ =
      node_.advertise<diagnostic_msgs::DiagnosticArray>(names::kDiagnostics, 10);
  static_tf_.sendTransform(worldTransform(frames_.world, frames_.base, scene_.X_WB));
  if (options_.handle) {
    const double size = std::clamp(4.0 * scene_.looks.back().separator_radius, 0.1, 0.15);
    handle_ = std::make_unique<TipHandle>(
        frames_.base, scene_.planar.has_value(), size, [this](const TipTarget& target) {
          aimTip({names::kTipTarget, names::kInteractiveMarker, target.header.stamp},
                 fromMsg(target, frames_.base));
        });
  }

  using Node = PressureCommandNode;
  pressure_subscriber_ = listen(node_, names::kPressureTarget, 10, &Node::onPressureTarget, this);
  shape_subscriber_ = listen(node_, names::kShapeTarget, 10, &Node::onShapeTarget, this);
  tip_subscriber_ = listen(node_, names::kTipTarget, 10, &Node::onTipTarget, this);

  reload_ =
      std::make_unique<ReloadServer>(ros::NodeHandle("~"), options_.scene, options_.scene_folder,
                                     [this](io::Scene next) { adopt(std::move(next)); });

  const bool own = options_.regulator == "scene";
  const bool hardware = own && regulator::isHardware(requireRegulator(scene_));
  if (hardware) {
    refuseSimulatedTime();
    guard_ = startGuard(options_.scene, options_.realtime_priority);
  }
  tellRealtime(hardware);
  std::unique_ptr<regulator::RegulatorIo> io;
  try {
    if (own) io = startRegulator(scene_, options_.rate, options_.realtime_priority);
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
      [this](const PressureLoop::Reading& reading) { take(reading.pressure, reading.stamp); });
  draw_timer_ = repeat(node_, "the drawing", 1.0 / options_.draw_rate, &Node::onDraw, this);
  diagnose_timer_ = repeat(node_, "the diagnostics", 1.0, &Node::onDiagnose, this);
  ROS_INFO("%s: %d actuators in %d sections, loop at %g Hz", scene_.name.c_str(),
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
                         "~allow_sim_time to true where that is meant");
  }
  ROS_WARN("%s: drives hardware under simulated time (~allow_sim_time)", scene_.name.c_str());
}

// Wanted, never required; without it a busy machine is the only one that suffers.
void PressureCommandNode::tellRealtime(bool hardware) const {
  const int priority = options_.realtime_priority;
  if (priority == 0) return;
  const auto tell = [hardware](const std::string& refusal, const char* success) {
    if (refusal.empty()) {
      ROS_INFO("%s", success);
    } else {
      ROS_LOG(hardware ? ros::console::levels::Warn : ros::console::levels::Info,
              ROSCONSOLE_DEFAULT_NAME, "%s; without it other programs may delay a vent",
              refusal.c_str());
    }
  };
  tell(regulator::tryRealtime(priority), "the pressure loop has real-time priority");
  if (hardware) tell(regulator::lockMemory(), "the node's memory is locked");
}

void PressureCommandNode::tellTier() const {
  const statics::TierChoice& choice = scene_.model.choice();
  ROS_INFO("%s: tier %s: %s", scene_.name.c_str(), choice.setting.name().c_str(),
           choice.reason.c_str());
}

void PressureCommandNode::solve() {
  const Eigen::VectorXd pressure = scene_.arm.clamped(measured_);
  solution_ = scene_.model.solve(pressure);
  if (solution_.converged() || !unsolved_.add()) return;
  std::ostringstream at;
  at << (1e-3 * pressure).transpose();
  ROS_WARN(
      "%s: the %s model finds no shape that holds the load at %s kPa (%s, residual %.2g; %lu times "
      "so far): no model is published there; check the scene's load and arm.stiffness.K_eps_n",
      scene_.name.c_str(), scene_.model.choice().setting.name().c_str(), at.str().c_str(),
      statics::nameOf(solution_.status), solution_.residual,
      static_cast<unsigned long>(unsolved_.total()));
}

void PressureCommandNode::onPressureTarget(const ros::MessageEvent<const PressureArray>& event) {
  const PressureArray& target = *event.getMessage();
  const Sender sender{names::kPressureTarget, event.getPublisherName(), target.header.stamp};
  const auto checked = fresh(sender, fromMsg(target, scene_.arm, loop_->goal()));
  const Eigen::VectorXd* pressure = admit(sender, checked);
  if (pressure != nullptr && command(sender, *pressure)) {
    ledger_.taken();
    status_publisher_.publish(answerTo(sender));
  }
}

void PressureCommandNode::onShapeTarget(const ros::MessageEvent<const ShapeTarget>& event) {
  const ShapeTarget& target = *event.getMessage();
  const Sender sender{names::kShapeTarget, event.getPublisherName(), target.header.stamp};
  const auto checked = fresh(sender, fromMsg(target, scene_.arm.sectionCount()));
  if (const model::Twists* twists = admit(sender, checked)) {
    follow(sender, solver_.toTwists(*twists, loop_->goal()));
  }
}

void PressureCommandNode::onTipTarget(const ros::MessageEvent<const TipTarget>& event) {
  const TipTarget& target = *event.getMessage();
  const Sender sender{names::kTipTarget, event.getPublisherName(), target.header.stamp};
  aimTip(sender, fresh(sender, fromMsg(target, frames_.base)));
}

void PressureCommandNode::aimTip(const Sender& sender, const control::Checked<TipGoal>& checked) {
  if (const TipGoal* goal = admit(sender, checked)) {
    const Eigen::VectorXd from = loop_->goal();
    follow(sender, goal->with_rotation ? solver_.toPose(goal->X_BT, from)
                                       : solver_.toPosition(goal->X_BT.translation, from));
  }
}

template <class T>
control::Checked<T> PressureCommandNode::fresh(const Sender& sender,
                                               control::Checked<T> checked) const {
  if (sender.stamp.isZero()) return checked;
  const double age = secondsBetween(sender.stamp, ros::Time::now());
  auto refusal = control::checkAge(age, scene_.safety.rules.target_timeout);
  return refusal ? control::Checked<T>(*refusal) : checked;
}

template <class T>
const T* PressureCommandNode::admit(const Sender& sender, const control::Checked<T>& checked) {
  // Checked before the lease: nonsense neither takes nor keeps it.
  if (const auto* refusal = std::get_if<control::Refusal>(&checked)) {
    drop(sender, *refusal);
    return nullptr;
  }
  if (!lease_.claim(sender.commander, regulator::steadyNow())) {
    char text[256];
    std::snprintf(text, sizeof text,
                  "%s commands the arm; stop it and wait for %g s (safety.commander_timeout_s)",
                  basics::quoted(lease_.holder()).c_str(), lease_.timeout());
    drop(sender, {control::Fault::kOtherCommander, text});
    return nullptr;
  }
  return &std::get<T>(checked);
}

void PressureCommandNode::drop(const Sender& sender, const control::Refusal& refusal) {
  ledger_.dropped(sender.topic, sender.commander, refusal);
  TargetStatus status = answerTo(sender);
  status.outcome = TargetStatus::DROPPED;
  status.fault = control::nameOf(refusal.fault);
  status.message = refusal.message;
  status_publisher_.publish(status);
}

void PressureCommandNode::follow(const Sender& sender, const statics::InverseResult& result) {
  if (!result.converged()) {
    drop(sender, {control::Fault::kNotConverged,
                  "no pressures were found for it; send a target closer to the arm's shape"});
    return;
  }
  if (!command(sender, result.input)) return;
  TargetStatus status = answerTo(sender);
  status.residual = result.residual;
  status.position_error = result.position_error;
  for (int i = 0; i < scene_.arm.actuatorCount(); ++i) {
    const std::string& name = scene_.arm.actuator(i).name;
    if (result.limits[i] == statics::Limit::kLower) status.at_lower_limit.push_back(name);
    if (result.limits[i] == statics::Limit::kUpper) status.at_upper_limit.push_back(name);
  }
  if (result.status == statics::InverseStatus::kReached) {
    ledger_.taken();
  } else {
    char text[160];
    std::snprintf(text, sizeof text,
                  "the tip stays %.1f mm away, residual %.2g m; the closest shape is commanded",
                  1e3 * result.position_error, result.residual);
    ledger_.closest(sender.topic, sender.commander, text);
    status.outcome = TargetStatus::CLOSEST;
    status.message = text;
  }
  status_publisher_.publish(status);
}

bool PressureCommandNode::command(const Sender& sender, const Eigen::VectorXd& pressure) {
  const std::string refusal = loop_->command(pressure);
  if (!refusal.empty()) drop(sender, {control::Fault::kNotEnabled, refusal});
  return refusal.empty();
}

void PressureCommandNode::requireSameRegulator(const io::Scene& next) const {
  const auto describe = [](const io::Scene& scene) {
    if (!scene.regulator) return std::string("none");
    const std::string channels = regulator::describeChannels(*scene.regulator);
    return regulator::describe(*scene.regulator) + (channels.empty() ? "" : ", " + channels);
  };
  if (describe(scene_) != describe(next)) {
    throw std::invalid_argument("scene " + next.name + " has another regulator: " + describe(next) +
                                ", expected " + describe(scene_) + "; end the nodes to change it");
  }
  if (!guard_) return;
  const std::string looser = control::loosened(first_safety_.channels, first_safety_.rules,
                                               next.safety.channels, next.safety.rules);
  if (!looser.empty()) {
    throw std::invalid_argument("scene " + next.name +
                                " is less safe than the one this node began with: " + looser +
                                "; end the nodes to change that");
  }
}

void PressureCommandNode::adopt(io::Scene next) {
  next = requirePneumatic(std::move(next));
  requireSameRig(scene_, next);
  requireSameRegulator(next);
  loop_->adopt(next.arm, next.safety.channels, next.safety.rules);
  if (next.safety.commander_timeout != lease_.timeout()) {
    const std::string holder = lease_.holder();
    lease_ = control::CommanderLease(next.safety.commander_timeout);
    if (!holder.empty()) lease_.claim(holder, regulator::steadyNow());
  }
  scene_ = std::move(next);
  solver_ = statics::InverseSolver(scene_.model);
  static_tf_.sendTransform(worldTransform(frames_.world, frames_.base, scene_.X_WB));
  tellTier();
  solve();
}

void PressureCommandNode::take(const Eigen::VectorXd& measured, const ros::Time& stamp) {
  measured_ = measured;
  solve();
  last_reading_ = ros::SteadyTime::now();
  ++readings_;
  if (!solution_.converged()) return;
  std_msgs::Header header;
  header.stamp = stamp;
  header.frame_id = frames_.base;
  model_publisher_.publish(toShapeMsg(header, scene_.model.choice(), solution_.shape));
  const auto every = static_cast<std::uint64_t>(std::lround(options_.rate / options_.tf_rate));
  if (readings_ % every == 0) sendFrames(stamp);
}

bool PressureCommandNode::measures() const {
  return !last_reading_.isZero() &&
         ros::SteadyTime::now() - last_reading_ < ros::WallDuration(kFresh);
}

void PressureCommandNode::sendFrames(const ros::Time& stamp) {
  if (stamp == last_tf_stamp_) return;  // a paused clock: tf warns of repeated stamps
  if (endsTf(stamp)) {
    if (far_stamps_.add()) {
      ROS_WARN(
          "pressure_measured is stamped %.1f s ahead of ROS time (%lu times so far): no frames are "
          "given for it; set the clocks alike",
          secondsBetween(ros::Time::now(), stamp), static_cast<unsigned long>(far_stamps_.total()));
    }
    return;
  }
  last_tf_stamp_ = stamp;
  tf_.sendTransform(curveTransforms(frames_, solution_.shape, stamp));
}

std::string PressureCommandNode::unmeasuredText() const {
  return options_.regulator == "scene"
             ? "the regulator has given no readings (see its diagnostics)"
             : "pressure_measured has not come: is the regulator's node up?";
}

// What the line says of itself, once each.
void PressureCommandNode::tellLineError(const regulator::IoStatus& line) {
  if (line.last_error.empty() || line.last_error == told_line_error_) return;
  told_line_error_ = line.last_error;
  ROS_WARN("regulator: %s", line.last_error.c_str());
}

void PressureCommandNode::onDraw(const ros::SteadyTimerEvent&) {
  if (handle_) {
    const statics::Tip commanded = scene_.model.tip(loop_->goal());
    if (commanded.converged()) handle_->follow(commanded.tip);
  }
  if (!measures() || !solution_.converged()) {
    if (drawn_) {
      marker_publisher_.publish(markers_.remove(ros::Time::now()));
      if (!measures() && losses_.add()) {
        ROS_WARN(
            "nothing was measured for %g s (%lu times so far): %s; the arm is drawn again once it "
            "is",
            kFresh, static_cast<unsigned long>(losses_.total()), unmeasuredText().c_str());
      }
    }
    drawn_ = false;
    return;
  }
  drawn_ = true;
  marker_publisher_.publish(markers_.draw(solution_.shape, measured_, ros::Time::now()));
}

void PressureCommandNode::onDiagnose(const ros::SteadyTimerEvent&) {
  using diagnostic_msgs::DiagnosticStatus;
  const ros::SteadyTime now = ros::SteadyTime::now();
  const PressureLoop::Snapshot path = loop_->snapshot();
  const std::uint64_t turns = path.turns;
  const double rate =
      static_cast<double>(turns - diagnosed_turns_) / (now - last_diagnosis_).toSec();
  last_diagnosis_ = now;
  diagnosed_turns_ = turns;

  diagnostic_msgs::DiagnosticArray msg;
  msg.header.stamp = ros::Time::now();
  msg.status.resize(3);
  DiagnosticStatus& targets = msg.status[0];
  const std::string& node = ros::this_node::getName();
  targets.name = statusName(node, names::kTargetsStatus);
  ledger_.report(targets);
  addValue(targets, names::kLeaseHolderKey, lease_.holder());
  DiagnosticStatus& loop = msg.status[1];
  loop.name = statusName(node, names::kLoopStatus);
  const bool slow = rate < kSlowShare * options_.rate;
  loop.level = slow ? DiagnosticStatus::WARN : DiagnosticStatus::OK;
  loop.message = slow ? "the loop is slower than wanted" : "the loop keeps its rate";
  if (!measures()) {
    const bool never = last_reading_.isZero();
    loop.level = never ? DiagnosticStatus::WARN : DiagnosticStatus::ERROR;
    loop.message = never ? "waits for the first pressure_measured" : unmeasuredText();
  }
  addValue(loop, names::kRateKey, fixed(rate));
  addValue(loop, names::kWantedRateKey, fixed(options_.rate));
  addValue(loop, names::kBadReadingsKey, std::to_string(path.bad_readings.total()));
  DiagnosticStatus& model = msg.status[2];
  model.name = statusName(node, names::kModelStatus);
  const statics::TierChoice& choice = scene_.model.choice();
  const bool solved = solution_.converged();
  model.level = solved ? DiagnosticStatus::OK : DiagnosticStatus::ERROR;
  model.message = solved ? "the model finds the arm's shape"
                         : "the model finds no shape that holds the load: none is published; check "
                           "the scene's load and arm.stiffness.K_eps_n";
  addValue(model, names::kTierKey, statics::nameOf(choice.setting.tier));
  addValue(model, names::kOrderKey, std::to_string(choice.setting.order));
  addValue(model, names::kTierReasonKey, choice.reason);
  addValue(model, names::kSolveStatusKey, statics::nameOf(solution_.status));
  addValue(model, names::kUnsolvedKey, std::to_string(unsolved_.total()));
  if (path.io) tellLineError(*path.io);
  for (DiagnosticStatus& status : pressureStatuses(node, scene_, path)) {
    msg.status.push_back(std::move(status));
  }
  if (guard_ && control::isGone(guard_->state())) replaceGuard();
  for (DiagnosticStatus& status : msg.status) status.hardware_id = scene_.name;
  diagnostics_publisher_.publish(msg);
}

void PressureCommandNode::replaceGuard() {
  const bool tell = guard_losses_.add();
  if (tell) {
    ROS_ERROR(
        "the guard, which vents where this node is killed, has ended or stands still (%lu times so "
        "far): the arm vents, and another guard is started",
        static_cast<unsigned long>(guard_losses_.total()));
  }
  guard_->dismiss();  // one that wakes up is not to vent behind the back of the next
  try {
    auto next = startGuard(options_.scene, options_.realtime_priority);
    loop_->guardedBy(next);
    guard_ = std::move(next);
  } catch (const std::runtime_error& error) {
    if (tell) ROS_ERROR("%s; the arm stays vented until one can be", error.what());
  }
}

TargetStatus PressureCommandNode::answerTo(const Sender& sender) const {
  TargetStatus status;
  status.header.stamp = ros::Time::now();
  status.target_stamp = sender.stamp;
  status.topic = sender.topic;
  status.commander = sender.commander;
  status.outcome = TargetStatus::TAKEN;
  return status;
}

}  // namespace helix_arm::ros_bridge
