#pragma once

#include <memory>
#include <optional>
#include <string>

#include <ros/node_handle.h>
#include <ros/steady_timer.h>
#include <ros/time.h>
#include <std_srvs/SetBool.h>
#include <std_srvs/Trigger.h>

#include "command_link.hpp"
#include "follow_action.hpp"
#include "helix_arm/follow/visual_servo.hpp"
#include "helix_arm/io/scene.hpp"
#include "loop_reports.hpp"
#include "loop_targets.hpp"
#include "procedures/loop_config.hpp"
#include "procedures/suspect_watch.hpp"
#include "ros_bridge/common/arm_frames.hpp"
#include "ros_bridge/common/diagnostics.hpp"
#include "ros_bridge/common/guarded_callbacks.hpp"
#include "ros_bridge/common/parameters.hpp"
#include "ros_bridge/common/run_node.hpp"
#include "ros_bridge/names.hpp"

namespace helix_arm::ros_bridge {

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
  VisualServoNode();

  /// Not while the arm follows the loop: it is to be brought to rest first.
  bool mayEnd() const override { return !link_.isBusy(); }

 private:
  using Self = VisualServoNode;
  using Trigger = std_srvs::Trigger;
  using SetBool = std_srvs::SetBool;

  void onReading(const PressureArrayConstPtr& message);
  void onMeasured(const ArmShapeConstPtr& message);

  void onVision(const VisionStatusConstPtr& status) { moved_ = status->base_moved; }

  void onTags(const TagDetectionsConstPtr& detections);

  /// Takes the measured shapes that wait for their tags no longer.
  void look();
  void onSeen(const SeenArm& seen);
  bool onCloseLoop(const SetBool::Request& request, SetBool::Response& response);
  bool onReset(const Trigger::Request&, Trigger::Response& response);
  void draw();
  void diagnose();
  void adopt(io::Scene next);
  void turn(const ros::Time& stamp, const Eigen::VectorXd& reading);
  void aim();
  void command(const follow::Turn& turn);

  bool isWanted() { return action_.wants() || targets_.target().has_value(); }

  void letGo();
  void giveUp(const std::string& reason);

  // A camera that has moved comes first: through it the arm seems to move otherwise.
  std::string suspects() const;

  // A suspect is told once, not for each search that finds it again.
  void tellSuspect();

  std::string reason() { return ledBySuspect(*suspects_, stateReason()); }

  std::string stateReason();

  // Forces and budget are doubts: a camera that has moved looks like them.
  std::string closedReason() const;
  void tellState(follow::LoopState before);

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

}  // namespace helix_arm::ros_bridge
