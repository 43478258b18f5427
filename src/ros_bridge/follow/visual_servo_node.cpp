#include <Eigen/Core>
#include <algorithm>
#include <cstddef>
#include <deque>
#include <functional>
#include <optional>
#include <string>
#include <utility>
#include <variant>
#include <vector>

#include <diagnostic_msgs/DiagnosticArray.h>
#include <ros/node_handle.h>
#include <ros/steady_timer.h>
#include <ros/this_node.h>
#include <ros/time.h>
#include <std_srvs/SetBool.h>
#include <std_srvs/Trigger.h>

#include "command_link.hpp"
#include "follow_action.hpp"
#include "helix_arm/ArmShape.h"
#include "helix_arm/PressureArray.h"
#include "helix_arm/TagDetections.h"
#include "helix_arm/basics/requirement.hpp"
#include "helix_arm/control/target_check.hpp"
#include "helix_arm/follow/path_check.hpp"
#include "helix_arm/follow/visual_servo.hpp"
#include "helix_arm/io/scene.hpp"
#include "helix_arm/localization/tag_layout.hpp"
#include "helix_arm/model/curve.hpp"
#include "helix_arm/model/shape.hpp"
#include "helix_arm/procedures/budget_table.hpp"
#include "helix_arm/procedures/follow_run.hpp"
#include "loop_diagnostics.hpp"
#include "loop_publisher.hpp"
#include "loop_targets.hpp"
#include "ros_bridge/common/arm_frames.hpp"
#include "ros_bridge/common/conversions.hpp"
#include "ros_bridge/common/diagnostics.hpp"
#include "ros_bridge/common/file_access.hpp"
#include "ros_bridge/common/guarded_callbacks.hpp"
#include "ros_bridge/common/log.hpp"
#include "ros_bridge/common/model_history.hpp"
#include "ros_bridge/common/parameters.hpp"
#include "ros_bridge/common/reload_server.hpp"
#include "ros_bridge/common/run_node.hpp"
#include "ros_bridge/names.hpp"

namespace helix_arm::ros_bridge {
namespace {

using follow::LoopState;

constexpr double kFresh = 1.0;  // pressures silent for longer end a command [s]

ros::console::Level levelOf(LoopState state, LoopState before) {
  if (state == LoopState::kDiverging) return ros::console::levels::Error;
  const bool lost = state == LoopState::kCoasting || state == LoopState::kDoubtful ||
                    (state == LoopState::kOpen && before != LoopState::kIdle);
  return lost ? ros::console::levels::Warn : ros::console::levels::Info;
}

/// Private parameters of visual_servo.
struct VisualServoOptions {
  ParameterReader reader{ros::NodeHandle("~")};
  std::string scene = reader.file("scene", "config/scenes", ".yaml");  ///< as pressure_command's
  double rate = reader.number("rate", 50.0, {1.0, 1000.0});  ///< of loop_status and estimate [Hz]
  double draw_rate = reader.number("draw_rate", 20.0, {0.1, 100.0});  ///< of the markers [Hz]
  std::string frame_prefix = reader.frame("frame_prefix", "");
  bool handle = reader.flag("handle", true);  ///< show the interactive marker
  std::string scene_folder = reader.folder("scene_folder", defaultFolder());  ///< likewise

  VisualServoOptions() { reader.finish(); }
};

/// Brings the tip where it is wanted by what the camera sees: a follow::VisualServo as one
/// commander of pressure_command.
///
/// Subscribes
/// - tip_target (TipTarget), tip_pose (geometry_msgs/PoseStamped), shape_target (ShapeTarget):
///   targets, in any frame that tf relates to the arm's base; tip_handle/feedback
/// - measured (ArmShape), tag_detections (TagDetections): of vision; the second tells which tags a
///   shape was fitted to
/// - pressure_measured, pressure_command (PressureArray), safety_state (SafetyState),
///   target_status (TargetStatus): of pressure_command
/// - /tf, /tf_static
///
/// Publishes
/// - pressure_target (PressureArray): with every pressure_measured while somebody commands the loop
/// - target_status (TargetStatus): result of each target
/// - loop_status (LoopStatus); estimate (ArmShape, tier `estimated`, with covariance): the shape of
///   the corrected model at the measured pressures
/// - error_budget (ErrorBudget), 5 Hz; external_load (ExternalLoad), latched
/// - loop_markers (visualization_msgs/MarkerArray): LoopMarkers; tip_handle/update and
///   tip_handle/update_full
/// - /diagnostics: `<node>: loop`, `<node>: correction`, `<node>: targets`, 1 Hz
///
/// Services
/// - ~close_loop (std_srvs/SetBool): false keeps what the pictures teach out of the command
/// - ~reset (std_srvs/Trigger): forgets what they taught; the way out of the state `diverging`
/// - ~reload (Reload): another file of the same rig, while nobody commands the loop; forgets, too,
///   and ends the hold of a goal, after which the arm rests
///
/// Action
/// - ~follow_tip_path (FollowTipPath): moves the tip along a path
///
/// Parameters: VisualServoOptions.
///
/// One turn per pressure_measured, whose stamp is the turn's time; the node has no timer of its own
/// that moves the arm. Silence of commanders goes by a steady clock: whoever sends no target for
/// safety.target_timeout lets go of the arm, which then vents, unless somebody else commands it. A
/// running goal counts as a commander as long as the node that sent it answers (ClientWatch). Where
/// somebody else asks pressure_command for rest, goals, holds and targets end. After the hold of a
/// goal, and where the node is asked to end, it asks pressure_command for rest. Nothing here
/// enables the arm, except that a target may enable a simulated one.
///
/// Ends with 0 when asked to, 1 when the ROS master is lost, 2 on a bad scene or parameter. All of
/// it runs in the main thread, except that goals are read and their paths checked in others.
class VisualServoNode : public Node {
 public:
  /// @throws io::DocumentError, ParameterError or std::invalid_argument with every fault found.
  VisualServoNode() {
    logInfo("%s: closes the loop of %d actuators over vision", scene_.name.c_str(),
            scene_.arm.actuatorCount());
  }

  /// Not while the arm follows the loop: it is to be brought to rest first.
  bool mayEnd() const override { return !link_.isBusy(); }

 private:
  using Self = VisualServoNode;
  using Trigger = std_srvs::Trigger;
  using SetBool = std_srvs::SetBool;

  void onReading(const PressureArrayConstPtr& message) {
    if (EndRequest::made()) return;
    const auto checked = control::checkReading(scene_.arm, message->name, message->pressure);
    if (const auto* refusal = std::get_if<control::Refusal>(&checked)) {
      if (!bad_readings_.add()) return;
      logWarning("a pressure_measured was dropped (%lu so far): %s", bad_readings_.total(),
                 refusal->message.c_str());
      return;
    }
    last_reading_ = ros::SteadyTime::now();
    const ros::Time& stamp = message->header.stamp;
    turn(stamp.isZero() ? ros::Time::now() : stamp, std::get<Eigen::VectorXd>(checked));
  }

  void onSeen(const SeenArm& seen) {
    // Simulated time may reach this node later than the readings that it stamps.
    const double now = std::max(ros::Time::now().toSec(), stamp_.toSec());
    const estimation::Observation observation =
        loop_.picture(seen.stamp.toSec(), now, seen.shape.twists(), seen.covariance, seen.tags);
    pictures_.saw(now, secondsBetween(stamp_, seen.stamp), observation, loop_.tracker(),
                  seen.tags.has_value());
    if (!observation.accepted()) return;
    last_picture_ = seen.stamp;
    load_publisher_.publish(seen.stamp, loop_);
    if (action_.runs()) {
      lie::SE3 tip = model::tipPose(seen.shape);
      tip.translation += loop_.load().tip_beyond_fit;
      action_.picture(seen.stamp, tip, LoopPublisher::tipCovariance(view()));
    }
  }

  bool onCloseLoop(SetBool::Request& request, SetBool::Response& response) {
    closes_ = request.data;
    loop_.close(closes_);
    response.success = true;
    response.message = closes_ ? "the loop closes when the arm is seen"
                               : "the loop stays open: the correction fades out within a second";
    logInfo("close_loop: %s", response.message.c_str());
    return true;
  }

  bool onReset(Trigger::Request&, Trigger::Response& response) {
    loop_.reset();
    load_publisher_.publish(stamp_, loop_);
    response.success = true;
    response.message =
        "what was learnt from pictures is cleared: the correction fades out within a second";
    logInfo("reset: %s", response.message.c_str());
    return true;
  }

  void onDraw(const ros::SteadyTimerEvent&) {
    const bool measures = !last_reading_.isZero() &&
                          ros::SteadyTime::now() - last_reading_ < ros::WallDuration(kFresh);
    if (!measures) {
      giveUp("no pressure_measured is received; is the regulator's node running?");
      letGo();
      publisher_.clear();
    }
    if (EndRequest::made()) {
      giveUp("the node of the loop is shutting down");
      link_.rest();
      letGo();
    }
    link_.restIfDue();
    publisher_.draw();
  }

  void onDiagnose(const ros::SteadyTimerEvent&) {
    diagnostics_.publish(
        ros::this_node::getName(), scene_.name,
        {pictures_.loop(loop_, reason()), pictures_.correction(loop_), targets_.status()});
  }

  void adopt(io::Scene next) {
    next = requirePneumatic(std::move(next));
    requireSameRig(scene_, next);
    basics::require(!action_.runs() && !targets_.target(),
                    "the loop commands the arm; cancel its goal, or send it no target for ",
                    scene_.safety.rules.target_timeout, " s, and reload again");
    follow::VisualServo loop(next.model, procedures::loopConfigOf(next));
    loop.close(closes_);
    if (action_.wants()) {  // the last place of a goal, which is the old model's
      action_.endHold();
      link_.rest();
    }
    scene_ = std::move(next);
    loop_ = std::move(loop);
    targets_.adopt();
    observation_.adopt();
    load_publisher_.publish(stamp_, loop_);
  }

  void turn(const ros::Time& stamp, const Eigen::VectorXd& reading) {
    observation_.poll();
    const LoopState before = loop_.state();
    stamp_ = stamp;
    const double time = stamp.toSec();
    loop_.enable(link_.follows());
    if (link_.takeEnabling()) targets_.enabled();
    action_.prepare(time, loop_, link_);
    aim();
    const follow::Turn& turn = loop_.reading(time, link_.setPoint().value_or(reading), reading);
    command(turn);
    if (turn.commands) action_.watch(time, turn);
    tellState(before);
    load_publisher_.publishChange(stamp, loop_);
    publisher_.publish(view());
  }

  void aim() {
    const auto& target = targets_.target();
    const bool changed = targets_.takeChange();
    if (target && action_.runs()) {
      targets_.refuse({control::Fault::kOtherCommander,
                       "a goal of ~follow_tip_path commands the arm; cancel it first"});
    } else if (target && link_.follows() && (changed || !loop_.hasTarget())) {
      action_.endHold();
      loop_.aimAt(*target);
    }
    if (isWanted()) return;
    if (action_.takeEndOfHold()) link_.rest();
    letGo();
  }

  void command(const follow::Turn& turn) {
    if (turn.commands) {
      link_.send(turn.pressure);
      if (targets_.areUnanswered()) {
        targets_.answer({turn.status, turn.residual, turn.position_error, turn.limits});
      }
      return;
    }
    if (!isWanted()) return;
    if (const auto refusal = link_.refusal()) {
      targets_.refuse(*refusal);
      letGo();
    } else {
      link_.ask();
    }
  }

  bool isWanted() { return action_.wants() || targets_.target().has_value(); }

  void letGo() {
    loop_.release();
    link_.fallSilent();
  }

  void giveUp(const std::string& reason) {
    targets_.refuse({control::Fault::kNotEnabled, reason});
    action_.abandon(reason);
  }

  // With copies of the present state, since the check runs in another thread.
  PathCheck pathCheck() const {
    Eigen::VectorXd slew(scene_.arm.actuatorCount());
    for (int i = 0; i < scene_.arm.actuatorCount(); ++i) {
      slew[i] = scene_.safety.channels[static_cast<std::size_t>(i)].slew;
    }
    const Eigen::VectorXd start =
        scene_.arm.clamped(link_.setPoint().value_or(scene_.arm.inputAt(0)));
    return [slew, start, model = scene_.model, correction = loop_.tracker().correction()](
               const control::TipPath& path, double tolerance,
               const std::atomic<bool>& stop) -> std::string {
      statics::InverseSolver solver(model);
      solver.correct(correction);
      const auto refusal = follow::checkPath(path, model.arm(), solver, start, {tolerance, slew},
                                             [&stop] { return stop.load(); });
      return refusal ? refusal->reason : std::string();
    };
  }

  LoopPublisher::View view() {
    return {stamp_, loop_, last_picture_, commander(), reason(), pictures_};
  }

  std::string commander() {
    if (action_.wants()) return names::kFollowTipPath;
    return targets_.commander();
  }

  std::string reason() {
    const LoopState state = loop_.state();
    const bool unseen = state == LoopState::kCoasting || (state == LoopState::kOpen && closes_);
    if (loop_.turn().held && unseen) {
      return "contact with the arm, and no picture of it since then: path and correction are held "
             "until the arm is seen to be free; check the camera (vision_status)";
    }
    if (unseen && !pictures_.wrongStamp().empty()) return pictures_.wrongStamp();
    switch (state) {
      case LoopState::kIdle:
        return isWanted() ? "waits for the arm: " + link_.whyNot() : "the loop has no target";
      case LoopState::kOpen:
        if (!closes_) return "kept open by ~close_loop";
        return last_picture_ ? "the arm is not seen; check vision_status, and the refused "
                               "pictures in the diagnostics"
                             : "no message on measured was used yet; is vision running?";
      case LoopState::kClosed:
        return closedReason();
      case LoopState::kCoasting:
        return "the arm is not seen for the moment: the correction is held";
      case LoopState::kYielding:
        return "contact with the arm: path and correction are held; clear the arm";
      case LoopState::kDoubtful:
        return "the correction is held, since " + procedures::driftText(loop_.drift());
      case LoopState::kDiverging:
        break;
    }
    return "the tip moves away from a target within the model's reach: the arm does not bend "
           "as its model does; check for swapped hoses, tags and signs, then call ~reset";
  }

  // Forces and budget are doubts: a camera that has moved looks like them.
  std::string closedReason() const {
    const std::string out = "follows the measured shape";
    if (loop_.load().contact) {
      return out + ", which shows contact (external_load): a load, or the camera or base has moved";
    }
    if (loop_.budget() && loop_.budget()->state == estimation::BudgetState::kOutside) {
      return out +
             ", which the calibration does not explain (error_budget): check arm, load, camera "
             "and base, then calibrate again";
    }
    return out;
  }

  void tellState(LoopState before) {
    const LoopState state = loop_.state();
    if (state == before) return;
    logLine(levelOf(state, before), "%s: %s", follow::nameOf(state), reason().c_str());
  }

  const VisualServoOptions options_{};
  io::Scene scene_ = requirePneumatic(io::loadScene(options_.scene));
  follow::VisualServo loop_{scene_.model, procedures::loopConfigOf(scene_)};
  bool closes_ = true;
  ros::Time stamp_;                        ///< of the last turn
  ros::SteadyTime last_reading_;           ///< zero: none yet
  std::optional<ros::Time> last_picture_;  ///< that the loop used
  FaultCount bad_readings_;

  ros::NodeHandle node_, private_node_{"~"};
  FrameLookup frames_{node_, options_.frame_prefix + names::kBaseFrame};
  LoopDiagnostics pictures_;
  CommandLink link_{node_, scene_};
  LoopTargets targets_{node_, scene_, frames_};
  LoopPublisher publisher_{
      node_,
      scene_,
      frames_.baseFrame(),
      options_.rate,
      options_.draw_rate,
      options_.handle ? [this](const TipTarget& target) { targets_.takeFromHandle(target); }
                      : TipHandle::OnTarget()};
  LoadPublisher load_publisher_{node_, frames_.baseFrame()};
  FollowAction action_{private_node_, scene_, frames_, targets_, [this] { return pathCheck(); }};
  DiagnosticsPublisher diagnostics_{node_};
  const ros::Subscriber readings_ =
      listen(node_, names::kPressureMeasured, 10, &Self::onReading, this);
  ObservationIntake observation_{node_, scene_, frames_.baseFrame(), pictures_,
                                 [this](const SeenArm& seen) { onSeen(seen); }};
  const ros::ServiceServer close_ =
      serve(private_node_, names::kCloseLoop, &Self::onCloseLoop, this);
  const ros::ServiceServer reset_ = serve(private_node_, names::kReset, &Self::onReset, this);
  ReloadServer reload_{private_node_, options_.scene, options_.scene_folder,
                       [this](io::Scene next) { adopt(std::move(next)); }};
  const ros::SteadyTimer draw_ =
      repeat(node_, "the drawing", 1.0 / options_.draw_rate, &Self::onDraw, this);
  const ros::SteadyTimer diagnose_ = repeat(node_, "the diagnostics", 1.0, &Self::onDiagnose, this);
};

}  // namespace

std::unique_ptr<Node> makeVisualServo() { return std::make_unique<VisualServoNode>(); }

}  // namespace helix_arm::ros_bridge
