#pragma once

#include <atomic>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include <diagnostic_msgs/DiagnosticStatus.h>
#include <ros/callback_queue.h>
#include <ros/node_handle.h>
#include <ros/spinner.h>
#include <ros/steady_timer.h>
#include <ros/time.h>

#include "helix_arm/Forward.h"
#include "helix_arm/Inverse.h"
#include "helix_arm/basics/mutex.hpp"
#include "helix_arm/io/scene.hpp"
#include "helix_arm/regulator/guard_process.hpp"
#include "helix_arm/statics/arm_model.hpp"
#include "pressure_command_options.hpp"
#include "pressure_loop.hpp"
#include "ros_bridge/common/diagnostics.hpp"
#include "ros_bridge/common/reload_server.hpp"
#include "ros_bridge/common/run_node.hpp"
#include "shape_publisher.hpp"
#include "target_intake.hpp"

namespace helix_arm::ros_bridge {

/// The statuses `<node>: safety`, `<node>: regulator`, if it is the node's own, and `<node>:
/// channel <actuator>` for each actuator; pressures in kPa, as their keys say.
std::vector<diagnostic_msgs::DiagnosticStatus> pressureStatuses(const std::string& node,
                                                                const io::Scene& scene,
                                                                const PressureLoop::Snapshot& path);

/// The rate of a pressure loop between two calls.
class LoopRate {
 public:
  /// @param wanted  [Hz]
  explicit LoopRate(double wanted) : wanted_(wanted), last_look_(ros::SteadyTime::now()) {}

  /// The status `<node>: loop`: WARN if the loop was slower than wanted since the last call.
  /// @param now  when the snapshot was taken.
  diagnostic_msgs::DiagnosticStatus status(const std::string& node,
                                           const PressureLoop::Snapshot& path,
                                           const ros::SteadyTime& now);

 private:
  const double wanted_;
  std::uint64_t turns_ = 0;  ///< turns of the loop at the last call
  ros::SteadyTime last_look_;
};

/// Serves a node's `~forward` and `~inverse`: the model of its scene, for batches.
///
/// Calls are served one after the other in a thread of their own, so that a large batch delays
/// neither targets nor the pressure loop. A call that breaks a rule is answered with the rule.
class ModelServer {
 public:
  static constexpr std::size_t kMostForwardRows = 10'000;
  static constexpr std::size_t kMostInverseRows = 1000;

  ModelServer(const ros::NodeHandle& private_node, const statics::ArmModel& model);
  /// Ends a call that is being served.
  ~ModelServer();

  /// From now on of this model; calls that are being served end with the one before.
  void adopt(const statics::ArmModel& model) HELIX_ARM_EXCLUDES(mutex_);

 private:
  bool onForward(Forward::Request& request, Forward::Response& response);
  bool onInverse(Inverse::Request& request, Inverse::Response& response);
  std::shared_ptr<const statics::ArmModel> model() const HELIX_ARM_EXCLUDES(mutex_);
  /// Warns once of a call whose pressures seem to be in kPa.
  void watchUnit(const std::string& what, const model::Arm& arm, const std::vector<double>& rows);
  /// @throws std::runtime_error once the node ends.
  void goOn() const;

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
class PressureCommandNode {
 public:
  /// @throws io::DocumentError, ParameterError or std::invalid_argument with every fault found.
  PressureCommandNode();
  ~PressureCommandNode();

  /// Vents, and returns afterwards.
  int finish();

 private:
  void refuseSimulatedTime() const;
  void tellRealtime(bool hardware) const;
  void tellTier() const;
  void tellLineError(const regulator::IoStatus& line);

  void requireSameRegulator(const io::Scene& next) const;
  void adopt(io::Scene next);
  void onDraw(const ros::SteadyTimerEvent& event);
  void onDiagnose(const ros::SteadyTimerEvent& event);
  void replaceGuard();

  const PressureCommandOptions options_;
  io::Scene scene_;
  const io::SafetyConfig first_safety_;  ///< rules that no reloaded file may loosen, with hardware
  std::string told_line_error_;
  LoopRate loop_rate_;
  FaultCount guard_losses_;

  ros::NodeHandle node_;
  ros::Publisher diagnostics_publisher_;
  ShapePublisher shapes_;
  TargetIntake intake_;
  std::unique_ptr<ReloadServer> reload_;
  ModelServer model_server_;
  ros::SteadyTimer draw_timer_, diagnose_timer_;
  std::shared_ptr<regulator::GuardProcess> guard_;  ///< of hardware
  std::optional<PressureLoop> loop_;  ///< last, since its readings go to all of the above
};

}  // namespace helix_arm::ros_bridge
