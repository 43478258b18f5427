#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <string>

#include <ros/message_event.h>
#include <ros/node_handle.h>
#include <ros/steady_timer.h>
#include <tf2_ros/static_transform_broadcaster.h>
#include <tf2_ros/transform_broadcaster.h>

#include "helix_arm/TargetStatus.h"
#include "helix_arm/control/commander_lease.hpp"
#include "helix_arm/io/scene.hpp"
#include "helix_arm/regulator/guard_process.hpp"
#include "helix_arm/regulator/realtime.hpp"
#include "helix_arm/ros_bridge/common/arm_frames.hpp"
#include "helix_arm/ros_bridge/common/conversions.hpp"
#include "helix_arm/ros_bridge/common/reload_server.hpp"
#include "helix_arm/ros_bridge/common/run_node.hpp"
#include "helix_arm/ros_bridge/pressure/arm_markers.hpp"
#include "helix_arm/ros_bridge/pressure/pressure_loop.hpp"
#include "helix_arm/ros_bridge/pressure/target_ledger.hpp"
#include "helix_arm/ros_bridge/pressure/tip_handle.hpp"
#include "helix_arm/statics/inverse.hpp"

namespace helix_arm::ros_bridge {

/// Private parameters of pressure_command.
struct PressureCommandOptions {
  std::string scene;  ///< ~scene: absolute path, or the name of a shipped scene; required
  /// ~scene_folder: below which ~reload takes scenes, beside those of the package and ~scene;
  /// `helix_arm` below ROS_HOME by default.
  std::string scene_folder;
  double rate = 100.0;       ///< ~rate: of the loop, 1 to 1000 [Hz]
  double tf_rate = 100.0;    ///< ~tf_rate: of the moving frames, at most the loop's [Hz]
  double draw_rate = 20.0;   ///< ~draw_rate: of the markers, 0.1 to 100 [Hz]
  int frames = 5;            ///< ~frames: on the curve, model_0 .. model_(frames - 1), 2 to 1000
  std::string world_frame;   ///< ~world_frame: "world"
  std::string frame_prefix;  ///< ~frame_prefix: "", set before arm_base and model_*
  bool handle = true;        ///< ~handle: show the interactive marker
  /// ~regulator: `scene` drives the scene's regulator, hardware or simulated, from this node;
  /// `topic` leaves the pressures to another node, which reports them on pressure_measured.
  std::string regulator = "scene";
  /// ~auto_enable: a target enables the arm, at first and after commander or regulator fell silent.
  /// By default with ~regulator `scene`; never with hardware.
  bool auto_enable = true;
  /// ~allow_sim_time: drive hardware although ROS time is simulated; the safety rules run on the
  /// steady clock in any case.
  bool allow_sim_time = false;
  /// ~realtime_priority: of the threads between targets and valves (SCHED_FIFO), and of the guard,
  /// where the user's limits allow it: the log says what was given. 0: none, up to 99. With
  /// hardware the memory is locked along with it.
  int realtime_priority = regulator::kRealtimePriority;

  /// @throws ParameterError with every fault.
  static PressureCommandOptions load();
};

/// Brings the arm of a scene to pressures, shapes and tips, on the scene's regulator, real or
/// simulated, or on one that is another node's.
///
/// Between targets and regulator stands control::SafetyCore: whatever it finds wrong vents the arm,
/// and nothing moves until it is enabled again.
///
/// Subscribes
/// - pressure_target (PressureArray): gauge [Pa]; names left out keep their command
/// - shape_target (ShapeTarget): twists of all sections
/// - tip_target (TipTarget): position or pose of the tip, base frame
/// - tip_handle/feedback (visualization_msgs/InteractiveMarkerFeedback)
/// - pressure_measured (PressureArray): with ~regulator `topic`; gauge [Pa], all actuators
///
/// Publishes
/// - pressure_command (PressureArray): in force [Pa], on its way to the target as fast as the
/// scene's
///   slew lets it, 0 where the arm is not enabled; at once on a target, and with every loop
/// - pressure_measured (PressureArray): with ~regulator `scene`, as the regulator reads them [Pa]
/// - safety_state (SafetyState): latched, on every change
/// - model (ArmShape): with every pressure_measured, or the last where a tier is slower than they
///   come, the model's shape at the measured pressures clamped to the limits, under the scene's
///   load, with the stamp of that pressure_measured. On hardware, too, the measurement is all that
///   is known of the pressures.
/// - target_status (TargetStatus): what became of each target
/// - markers (visualization_msgs/MarkerArray); tip_handle/update and tip_handle/update_full
/// - /diagnostics (diagnostic_msgs/DiagnosticArray): `<node>: targets`, `<node>: loop`,
///   `<node>: model` (its tier, and whether it finds a shape), `<node>: safety`,
///   `<node>: regulator` and one `<node>: channel <actuator>` each, 1 Hz
/// - tf: world -> arm_base (static), arm_base -> model_0 .. model_(n-1) and model_tip
///
/// Services
/// - ~enable, ~vent (std_srvs/Trigger), ~emergency_stop (std_srvs/SetBool, latched while true):
/// their
///   answers say what became of it, and why
/// - ~reload (Reload): another file of the same rig and regulator. The command stays, and must be
///   inside the new limits; with hardware no rule may be looser than when the node began.
///
/// Parameters: PressureCommandOptions.
///
/// A bad target is dropped: counted, warned of once a fault and five seconds, answered on
/// target_status; the command stays. A target out of reach moves the arm to the closest reachable.
/// A target while the arm is not enabled is dropped with the reason.
/// Of several publishers the first to speak commands, until it has been silent for the scene's
/// safety.commander_timeout. All times are of a steady clock, so that a paused or simulated clock
/// neither stops the loop nor keeps a lease; the loop has a thread of its own, which no shape,
/// target or reload delays. Without fresh measurements, and where the model finds
/// no shape that holds the load, there is neither model nor drawing, and the diagnostics say so.
///
/// However it ends, the arm vents: in an orderly end by this node's last words to the regulator;
/// where it is killed or stands still, by a guard process (hardware), or by the regulator's node
/// when the commands stop. Ends with 0 when asked to, 1 when the ROS master is lost, 2 on a bad
/// scene or parameter, such as simulated time with hardware.
class PressureCommandNode {
 public:
  /// @throws io::DocumentError, ParameterError or std::invalid_argument with every fault found.
  PressureCommandNode();
  ~PressureCommandNode();

  /// Vents, and returns once that is done.
  int finish();

 private:
  /// Who sent which target.
  struct Sender {
    std::string topic;
    std::string commander;
    ros::Time stamp;
  };

  void onPressureTarget(const ros::MessageEvent<const PressureArray>& event);
  void onShapeTarget(const ros::MessageEvent<const ShapeTarget>& event);
  void onTipTarget(const ros::MessageEvent<const TipTarget>& event);
  void aimTip(const Sender& sender, const control::Checked<TipGoal>& checked);
  /// What was checked, unless its stamp says that it waited in some queue.
  template <class T>
  control::Checked<T> fresh(const Sender& sender, control::Checked<T> checked) const;

  /// The target's value when it is sound and its sender may command; else drops it and returns
  /// null.
  template <class T>
  const T* admit(const Sender& sender, const control::Checked<T>& checked);
  void drop(const Sender& sender, const control::Refusal& refusal);
  void follow(const Sender& sender, const statics::InverseResult& result);
  /// Commands it; else drops the target and returns false.
  bool command(const Sender& sender, const Eigen::VectorXd& pressure);

  void requireSameRegulator(const io::Scene& next) const;
  void adopt(io::Scene next);

  void take(const Eigen::VectorXd& measured, const ros::Time& stamp);
  bool measures() const;  ///< the last reading is fresh
  std::string unmeasuredText() const;
  void tellLineError(const regulator::IoStatus& line);

  void onDraw(const ros::SteadyTimerEvent& event);
  void onDiagnose(const ros::SteadyTimerEvent& event);
  void replaceGuard();
  void sendFrames(const ros::Time& stamp);

  void solve();  ///< the shape at the measured pressures
  void refuseSimulatedTime() const;
  void tellRealtime(bool hardware) const;
  void tellTier() const;
  TargetStatus answerTo(const Sender& sender) const;

  const PressureCommandOptions options_;
  io::Scene scene_;
  const io::SafetyConfig first_safety_;  ///< what no other file may loosen, with hardware
  const FrameNames frames_;
  statics::InverseSolver solver_;
  control::CommanderLease lease_;
  TargetLedger ledger_;
  ArmMarkers markers_;

  Eigen::VectorXd measured_;    ///< last reading [Pa]
  statics::Solution solution_;  ///< at the measured pressures, clamped
  ros::Time last_tf_stamp_;
  ros::SteadyTime last_reading_;  ///< zero: none yet
  std::uint64_t readings_ = 0;
  FaultCount far_stamps_;
  FaultCount unsolved_;  ///< readings at which the model finds no shape
  bool drawn_ = false;   ///< the arm is on the screen
  FaultCount losses_;    ///< of pressure_measured
  std::string told_line_error_;
  std::uint64_t diagnosed_turns_ = 0;  ///< of the loop
  ros::SteadyTime last_diagnosis_;

  ros::NodeHandle node_;
  ros::Publisher model_publisher_, status_publisher_;
  ros::Publisher marker_publisher_, diagnostics_publisher_;
  tf2_ros::TransformBroadcaster tf_;
  tf2_ros::StaticTransformBroadcaster static_tf_;
  std::unique_ptr<TipHandle> handle_;
  ros::Subscriber pressure_subscriber_, shape_subscriber_, tip_subscriber_;
  std::unique_ptr<ReloadServer> reload_;
  ros::SteadyTimer draw_timer_, diagnose_timer_;
  std::shared_ptr<regulator::GuardProcess> guard_;  ///< of hardware
  FaultCount guard_losses_;
  std::optional<PressureLoop> loop_;  ///< last: its readings come to all of the above
};

}  // namespace helix_arm::ros_bridge
