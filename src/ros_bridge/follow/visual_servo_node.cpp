#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <variant>

#include <ros/node_handle.h>
#include <ros/steady_timer.h>
#include <ros/this_node.h>
#include <ros/time.h>
#include <std_srvs/SetBool.h>
#include <std_srvs/Trigger.h>

#include "command_link.hpp"
#include "follow_action.hpp"
#include "helix_arm/basics/requirement.hpp"
#include "helix_arm/follow/visual_servo.hpp"
#include "helix_arm/io/scene.hpp"
#include "helix_arm/procedures/loop_config.hpp"
#include "helix_arm/procedures/suspect_watch.hpp"
#include "loop_reports.hpp"
#include "loop_targets.hpp"
#include "ros_bridge/common/arm_frames.hpp"
#include "ros_bridge/common/conversions.hpp"
#include "ros_bridge/common/diagnostics.hpp"
#include "ros_bridge/common/guarded_callbacks.hpp"
#include "ros_bridge/common/parameters.hpp"
#include "ros_bridge/common/run_node.hpp"
#include "ros_bridge/names.hpp"

namespace helix_arm::ros_bridge {
namespace {

// Covariance of the twists of a `measured`, or why it cannot be used.
control::Checked<Eigen::MatrixXd> covarianceOf(const ArmShape& shape, int sections) {
  const auto size = static_cast<Eigen::Index>(6) * sections;
  if (shape.twist_covariance.size() != static_cast<std::size_t>(size * size)) {
    return control::Refusal{control::Fault::kWrongSize,
                            std::to_string(shape.twist_covariance.size()) +
                                " numbers in twist_covariance; send " +
                                std::to_string(size * size) + ", the covariance of `twist`"};
  }
  return Eigen::Map<const Eigen::MatrixXd>(shape.twist_covariance.data(), size, size).eval();
}

using follow::LoopState;

constexpr double kFreshReading = 1.0;  // pressures silent for longer end a command [s]

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
/// commander of pressure_command, the node visual_servo of docs/nodes.md. Parameters:
/// VisualServoOptions.
///
/// One turn per pressure_measured, whose stamp is the turn's time; the node has no timer of its own
/// that moves the arm. Whoever sends no target for safety.target_timeout, by a steady clock, lets
/// go of the arm, which then vents, unless somebody else commands it. Where somebody else asks
/// pressure_command for rest, goals, holds and targets end. After the hold of a goal, and where the
/// node is asked to end, it asks pressure_command for rest.
///
/// All of it runs in the main thread, except that the paths of goals are checked in others.
class VisualServoNode : public Node {
 public:
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

  void onMeasured(const ArmShapeConstPtr& message) {
    const auto shape = fromMsg(*message, scene_.arm, frames_.baseFrame());
    const auto covariance = covarianceOf(*message, scene_.arm.sectionCount());
    for (const auto* refusal :
         {std::get_if<control::Refusal>(&shape), std::get_if<control::Refusal>(&covariance)}) {
      if (refusal == nullptr) continue;
      pictures_.sawForeign(refusal->message);
      return;
    }
    matcher_.add({message->header.stamp, std::get<model::Shape>(shape),
                  std::get<Eigen::MatrixXd>(covariance)},
                 ros::SteadyTime::now().toSec());
    look();
  }

  void onVision(const VisionStatusConstPtr& status) { moved_ = status->base_moved; }

  void onTags(const TagDetectionsConstPtr& detections) {
    if (!scene_.tags) return;
    matcher_.addTags(detections->header.stamp, fittedTags(*detections, *scene_.tags),
                     ros::SteadyTime::now().toSec());
    look();
  }

  /// Takes the measured shapes that wait for their tags no longer.
  void look() {
    while (const auto seen = matcher_.take(ros::SteadyTime::now().toSec())) onSeen(*seen);
  }

  void onSeen(const SeenArm& seen) {
    // Simulated time may reach this node later than the readings that it stamps.
    const double now = std::max(ros::Time::now().toSec(), stamp_.toSec());
    const estimation::Observation observation =
        loop_.picture(seen.stamp.toSec(), now, seen.shape.twists(), seen.covariance, seen.tags);
    pictures_.saw(now, secondsBetween(stamp_, seen.stamp), observation, loop_.tracker(),
                  seen.tags.has_value());
    if (suspects_->see(loop_, observation)) tellSuspect();
    if (!observation.accepted()) return;
    last_picture_ = seen.stamp;
    publisher_.publishLoad(seen.stamp, moved_);
    if (action_.runs()) {
      lie::SE3 tip = model::tipPose(seen.shape);
      tip.translation += loop_.load().tip_beyond_fit;
      const auto prediction = loop_.prediction();
      action_.picture(
          seen.stamp, tip,
          prediction ? prediction->tip_covariance : Eigen::Matrix3d(Eigen::Matrix3d::Zero()));
    }
  }

  bool onCloseLoop(const SetBool::Request& request, SetBool::Response& response) {
    closes_ = request.data;
    loop_.close(closes_);
    response.success = true;
    response.message = closes_ ? "the loop closes when the arm is seen"
                               : "the loop stays open: the correction fades out within a second";
    logInfo("close_loop: %s", response.message.c_str());
    return true;
  }

  bool onReset(const Trigger::Request&, Trigger::Response& response) {
    loop_.reset();
    loop_.distrustModel(false);
    suspects_.emplace(scene_);
    publisher_.publishLoad(stamp_, moved_);
    response.success = true;
    response.message =
        "what was learnt from pictures is cleared: the correction fades out within a second";
    logInfo("reset: %s", response.message.c_str());
    return true;
  }

  void draw() {
    const bool measures = !last_reading_.isZero() &&
                          ros::SteadyTime::now() - last_reading_ < ros::WallDuration(kFreshReading);
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

  void diagnose() {
    diagnostics_.publish(ros::this_node::getName(), scene_,
                         {pictures_.loop(loop_, reason(), suspects()), pictures_.correction(loop_),
                          targets_.admission().status()});
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
    suspects_.emplace(scene_);
    targets_.admission().adopt();
    matcher_.clear();
    publisher_.publishLoad(stamp_, moved_);
  }

  void turn(const ros::Time& stamp, const Eigen::VectorXd& reading) {
    look();
    const LoopState before = loop_.state();
    stamp_ = stamp;
    const double time = stamp.toSec();
    loop_.enable(link_.follows());
    if (link_.takeEnabling()) targets_.enabled();
    if (const std::string other = diagnostics_.otherScene(scene_); !other.empty()) {
      giveUp(other);
      link_.rest();
    }
    action_.prepare(time);
    aim();
    const follow::Turn& turn = loop_.reading(time, link_.setPoint().value_or(reading), reading);
    command(turn);
    if (turn.commands) action_.watch(time, turn);
    tellState(before);
    publisher_.publish(stamp_, last_picture_,
                       action_.wants() ? names::kFollowTipPath : targets_.commander(), reason());
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
      targets_.answer({turn.status, turn.residual, turn.position_error, turn.limits});
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

  // A camera that has moved comes first: through it the arm seems to move otherwise.
  std::string suspects() const {
    std::string out = moved_.empty() ? "" : "camera_moved: " + moved_;
    for (const std::string& one : procedures::textsOf(suspects_->suspects())) {
      out += (out.empty() ? "" : "; ") + one;
    }
    return out;
  }

  // A suspect is told once, not for each search that finds it again.
  void tellSuspect() {
    const std::vector<estimation::Suspect>& found = suspects_->suspects();
    const std::string first = found.empty() ? "" : found.front().cause + found.front().where;
    if (std::exchange(suspect_, first) == first || first.empty()) return;
    logWarning("%s", procedures::textsOf(found).front().c_str());
  }

  std::string reason() { return ledBySuspect(*suspects_, stateReason()); }

  std::string stateReason() {
    const LoopState state = loop_.state();
    if (!link_.blocked().empty()) return link_.blocked();
    const bool unseen = state == LoopState::kCoasting || (state == LoopState::kOpen && closes_);
    if (loop_.turn().held && unseen) {
      return "contact with the arm, and no picture of it since then: path and correction are held "
             "until the arm is seen to be free; " +
             std::string(kCheckVision);
    }
    if (unseen && !pictures_.wrongStamp().empty()) return pictures_.wrongStamp();
    switch (state) {
      case LoopState::kIdle:
        if (!targets_.refusal().empty()) return "waits for the arm: " + targets_.refusal();
        return isWanted() ? "waits for the arm: " + link_.whyNot() : "the loop has no target";
      case LoopState::kOpen:
        if (!closes_) return "kept open by ~close_loop";
        return std::string(last_picture_ ? "the arm is not seen; "
                                         : "no message on measured was used yet; ") +
               kCheckVision + ", and the refused pictures in the diagnostics";
      case LoopState::kClosed:
        return closedReason();
      case LoopState::kCoasting:
        return std::string("the arm is not seen for the moment: the correction is held; ") +
               kCheckVision;
      case LoopState::kYielding:
        return contactWords(*suspects_).what + ": path and correction are held; " +
               contactWords(*suspects_).remedy;
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
    if (!moved_.empty()) return out + ", but " + moved_;
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
  std::optional<procedures::SuspectWatch> suspects_{scene_};
  std::string suspect_;  ///< the first one that was told
  bool closes_ = true;
  ros::Time stamp_;                        ///< of the last turn
  ros::SteadyTime last_reading_;           ///< zero: none yet
  std::optional<ros::Time> last_picture_;  ///< that the loop used
  std::string moved_;  ///< where camera or base are not where the scene says: VisionStatus
  FaultCount bad_readings_;

  ros::NodeHandle node_, private_node_{"~"};
  FrameLookup frames_{node_, options_.frame_prefix + names::kBaseFrame};
  LoopDiagnostics pictures_;
  TagMatcher matcher_;
  CommandLink link_{node_, scene_};
  LoopTargets targets_{node_, scene_, frames_};
  LoopPublisher publisher_{
      node_,
      scene_,
      loop_,
      pictures_,
      suspects_,
      frames_.baseFrame(),
      options_.rate,
      options_.draw_rate,
      options_.handle
          ? [this](const TipTarget& target) { targets_.admission().takeFromHandle(target); }
          : TipHandle::OnTarget()};
  FollowAction action_{private_node_, scene_, frames_, targets_, loop_, link_, suspects_};
  DiagnosticsPublisher diagnostics_{node_};
  const ros::Subscriber readings_ =
      listen(node_, names::kPressureMeasured, 10, &Self::onReading, this);
  const ros::Subscriber measured_ = listen(node_, names::kMeasured, 10, &Self::onMeasured, this);
  const ros::Subscriber tags_ = listen(node_, names::kTagDetections, 10, &Self::onTags, this);
  const ros::Subscriber vision_ = listen(node_, names::kVisionStatus, 10, &Self::onVision, this);
  const ros::ServiceServer close_ =
      serve(private_node_, names::kCloseLoop, &Self::onCloseLoop, this);
  const ros::ServiceServer reset_ = serve(private_node_, names::kReset, &Self::onReset, this);
  ReloadServer reload_{private_node_, options_.scene, options_.scene_folder,
                       [this](io::Scene next) { adopt(std::move(next)); }};
  const ros::SteadyTimer draw_ =
      repeat(node_, "the drawing", 1.0 / options_.draw_rate, [this] { draw(); });
  const ros::SteadyTimer diagnose_ = repeat(node_, "the diagnostics", 1.0, [this] { diagnose(); });
};

}  // namespace

std::unique_ptr<Node> makeVisualServo() { return std::make_unique<VisualServoNode>(); }

}  // namespace helix_arm::ros_bridge
