#pragma once

#include <cstdint>
#include <memory>
#include <string>

#include <diagnostic_msgs/DiagnosticStatus.h>
#include <ros/node_handle.h>
#include <ros/steady_timer.h>
#include <ros/time.h>

#include "helix_arm/io/scene.hpp"
#include "keep_out_gate.hpp"
#include "model_server.hpp"
#include "plan_server.hpp"
#include "pressure_loop.hpp"
#include "regulator/guard_process.hpp"
#include "regulator/regulator_io.hpp"
#include "ros_bridge/common/diagnostics.hpp"
#include "ros_bridge/common/parameters.hpp"
#include "ros_bridge/common/run_node.hpp"
#include "shape_publisher.hpp"
#include "target_intake.hpp"

namespace helix_arm::ros_bridge {

/// Drives the arm of a scene to target pressures, shapes and tips, through the scene's regulator
/// (real or simulated) or another node's. docs/nodes.md lists its topics, services and parameters
/// (PressureCommandOptions); docs/safety.md tells who commands and when the arm vents.
///
/// Between targets and regulator stands control::SafetyCore: any fault vents the arm, and nothing
/// moves until it is enabled again. All times are of a steady clock, so that a paused or simulated
/// clock neither stops the loop nor keeps a lease.
///
/// The arm vents in every case when the node ends: in an orderly end by this node; if it is killed
/// or stopped, by a guard process (hardware), or by the regulator's node when the commands stop.
///
/// Its parts: TargetIntake accepts targets, PressureLoop drives the regulator, ShapePublisher shows
/// the arm at the readings. All of them but PressureLoop and ModelServer run in the main thread
/// only, so that no shape, target or reload delays the loop.
class PressureCommandNode : public Node {
 public:
  PressureCommandNode();
  ~PressureCommandNode() override { finish(); }

  /// Vents, and returns afterwards.
  int finish() override;

 private:
  /// Connects the regulator, if it is this node's, with a guard where it is hardware.
  regulator::PressurePath startPath();
  void refuseSimulatedTime() const;
  /// Real-time priority is optional; without it, only a busy machine is affected.
  void tellRealtime(bool hardware) const;
  void tellTier() const;
  /// Tells each new error of the line once.
  void tellLineError(const regulator::IoStatus& line);
  void requireSameRegulator(const io::Scene& next) const;
  void adopt(io::Scene next);
  void replaceGuard();
  void draw();
  void diagnose();
  /// WARN if the loop was slower than wanted since the last call.
  diagnostic_msgs::DiagnosticStatus loopStatus(const PressureLoop::Snapshot& path);

  const PressureCommandOptions options_{};
  io::Scene scene_ = requirePneumatic(io::loadScene(options_.scene));
  /// Rules that no reloaded file may loosen, with hardware.
  const io::SafetyConfig first_safety_ = scene_.safety;
  std::string told_line_error_;
  std::uint64_t told_turns_ = 0;  ///< of the loop, at the last diagnostics
  ros::SteadyTime last_diagnostics_ = ros::SteadyTime::now();
  FaultCount guard_losses_;

  ros::NodeHandle node_;
  DiagnosticsPublisher diagnostics_{node_};
  const LoopWatch watched_{node_};
  ShapePublisher shapes_;
  KeepOutGate gate_;                                ///< of loop_
  std::shared_ptr<regulator::GuardProcess> guard_;  ///< of hardware
  PressureLoop loop_;                               ///< its readings go to shapes_
  TargetIntake intake_;
  ModelServer model_server_;
  PlanServer plan_server_;
  ReloadServer reload_;
  ros::SteadyTimer draw_timer_, diagnose_timer_;
};

}  // namespace helix_arm::ros_bridge
