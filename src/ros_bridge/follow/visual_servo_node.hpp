#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <deque>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include <ros/node_handle.h>
#include <ros/steady_timer.h>
#include <ros/time.h>
#include <std_srvs/SetBool.h>
#include <std_srvs/Trigger.h>

#include "command_link.hpp"
#include "follow_action.hpp"
#include "helix_arm/ArmShape.h"
#include "helix_arm/PressureArray.h"
#include "helix_arm/TagDetections.h"
#include "helix_arm/follow/visual_servo.hpp"
#include "helix_arm/io/scene.hpp"
#include "helix_arm/localization/tag_layout.hpp"
#include "helix_arm/model/shape.hpp"
#include "loop_diagnostics.hpp"
#include "loop_publisher.hpp"
#include "loop_targets.hpp"
#include "ros_bridge/common/arm_frames.hpp"
#include "ros_bridge/common/diagnostics.hpp"
#include "ros_bridge/common/reload_server.hpp"
#include "ros_bridge/common/run_node.hpp"

namespace helix_arm::ros_bridge {

/// What one picture says of the arm.
struct SeenArm {
  ros::Time stamp;  ///< of the picture
  model::Shape shape;
  Eigen::MatrixXd covariance;  ///< of its twists
  /// Indices in the layout of the tags that were fitted, ascending; nothing if unknown.
  std::optional<std::vector<int>> tags = {};
};

/// Indices in the layout of the tags that a fit used, ascending; nothing if there is none, or if
/// one of them is not in the layout.
std::optional<std::vector<int>> fittedTags(const TagDetections& detections,
                                           const estimation::TagLayout& layout);

/// Joins each measured shape with the tags of its fit, by their stamps. They come on two topics, in
/// any order.
///
/// A shape waits for its tags at most kPatience; not at all once later tags have come, or where no
/// tags have come for kSilence. It then goes on without them. Shapes keep their order. At most
/// kMost shapes and kMost sets of tags are kept. Time is a number [s].
class TagMatcher {
 public:
  static constexpr double kPatience = 0.05;  ///< [s]
  static constexpr double kSilence = 1.0;    ///< [s]
  static constexpr std::size_t kMost = 8;

  void add(SeenArm seen, double now);
  /// @param tags  as SeenArm's.
  void addTags(const ros::Time& stamp, std::optional<std::vector<int>> tags, double now);
  /// The next shape that need not wait any more; nothing if there is none.
  std::optional<SeenArm> take(double now);
  /// Forgets shapes and tags.
  void clear();

 private:
  struct Waiting {
    SeenArm seen;
    double since;  ///< [s]
  };
  struct Tags {
    ros::Time stamp;
    std::optional<std::vector<int>> fitted;
  };

  bool mayGetTags(const Waiting& shape, double now) const;

  std::deque<Waiting> shapes_;  ///< as they came
  std::deque<Tags> tags_;       ///< by ascending stamp
  std::optional<double> last_tags_;
};

/// Takes the measured shapes with the tags of their fits.
///
/// Subscribes to measured and tag_detections. For the thread of the node's callback queue.
class ObservationIntake {
 public:
  using OnSeen = std::function<void(const SeenArm& seen)>;

  /// @param scene     Kept by reference: after a change to it, call adopt().
  /// @param pictures  gets the shapes that are not of this arm. Outlives this.
  /// @param on_seen   called with each shape, in the order of the messages.
  ObservationIntake(ros::NodeHandle& node, const io::Scene& scene, std::string base_frame,
                    LoopDiagnostics& pictures, OnSeen on_seen);

  /// Gives up the wait for tags that do not come. To be called regularly.
  void poll();
  /// Follows a change of the scene.
  void adopt() { matcher_.clear(); }

 private:
  void onMeasured(const ArmShapeConstPtr& shape);
  void onTags(const TagDetectionsConstPtr& detections);

  const io::Scene& scene_;
  const std::string base_frame_;
  LoopDiagnostics& pictures_;
  const OnSeen on_seen_;
  TagMatcher matcher_;
  ros::Subscriber measured_subscriber_, tags_subscriber_;
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
class VisualServoNode {
 public:
  /// @throws io::DocumentError, ParameterError or std::invalid_argument with every fault found.
  VisualServoNode();
  ~VisualServoNode();

  int finish() const { return kDone; }
  /// The arm follows the loop: it is to be brought to rest first.
  bool isBusy() const { return link_.isBusy(); }

 private:
  using Trigger = std_srvs::Trigger;
  using SetBool = std_srvs::SetBool;

  void onReading(const PressureArrayConstPtr& message);
  void onSeen(const SeenArm& seen);
  bool onCloseLoop(SetBool::Request& request, SetBool::Response& response);
  bool onReset(Trigger::Request&, Trigger::Response& response);
  void onDraw(const ros::SteadyTimerEvent& event);
  void onDiagnose(const ros::SteadyTimerEvent& event);
  void adopt(io::Scene next);

  void turn(const ros::Time& stamp, const Eigen::VectorXd& reading);
  void aim();
  void command(const follow::Turn& turn);
  bool isWanted() { return action_.wants() || targets_.target().has_value(); }
  void letGo();
  void giveUp(const std::string& reason);
  PathCheck pathCheck() const;
  LoopPublisher::View view();
  std::string commander();
  std::string reason();
  std::string closedReason() const;
  void tellState(follow::LoopState before);

  const VisualServoOptions options_;
  io::Scene scene_;
  follow::VisualServo loop_;
  bool closes_ = true;
  ros::Time stamp_;                        ///< of the last turn
  ros::SteadyTime last_reading_;           ///< zero: none yet
  std::optional<ros::Time> last_picture_;  ///< that the loop used
  FaultCount bad_readings_;

  ros::NodeHandle node_, private_node_{"~"};
  FrameLookup frames_;
  LoopDiagnostics pictures_;
  CommandLink link_;
  LoopTargets targets_;
  LoopPublisher publisher_;
  LoadPublisher load_publisher_;
  FollowAction action_;
  ros::Publisher diagnostics_publisher_;
  ros::Subscriber reading_subscriber_;
  ObservationIntake observation_;
  ros::ServiceServer close_server_, reset_server_;
  ReloadServer reload_;
  ros::SteadyTimer draw_timer_, diagnose_timer_;
};

inline bool mayEnd(const VisualServoNode& node) { return !node.isBusy(); }

}  // namespace helix_arm::ros_bridge
