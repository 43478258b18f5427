#pragma once

#include <string>

#include "helix_arm/regulator/realtime.hpp"

namespace helix_arm::ros_bridge {

/// Private parameters of pressure_command.
struct PressureCommandOptions {
  std::string scene;  ///< ~scene: path, or the name of a shipped scene; required
  /// ~scene_folder: folder from which ~reload accepts scenes, besides those of the package and
  /// ~scene; default: `helix_arm` below ROS_HOME.
  std::string scene_folder;
  double rate = 100.0;      ///< ~rate: of the loop, 1 to 1000 [Hz]
  double tf_rate = 100.0;   ///< ~tf_rate: of the moving frames, at most the loop's [Hz]
  double draw_rate = 20.0;  ///< ~draw_rate: of the markers, 0.1 to 100 [Hz]
  /// ~frames: number of frames on the curve, model_0 .. model_(frames - 1), 2 to 1000.
  int frames = 5;
  std::string world_frame;   ///< ~world_frame: "world"
  std::string frame_prefix;  ///< ~frame_prefix: "", set before arm_base and model_*
  bool handle = true;        ///< ~handle: show the interactive marker
  /// ~regulator: `scene` drives the scene's regulator, hardware or simulated, from this node;
  /// `topic` leaves the pressures to another node, which reports them on pressure_measured.
  std::string regulator = "scene";
  /// ~auto_enable: a target enables the arm, at first and after commander or regulator fell silent.
  /// Default: true with ~regulator `scene`; never with hardware.
  bool auto_enable = true;
  /// ~allow_sim_time: drive hardware although ROS time is simulated; the safety rules run on the
  /// steady clock in any case.
  bool allow_sim_time = false;
  /// ~realtime_priority: of the threads between targets and valves (SCHED_FIFO), and of the guard,
  /// if the user's limits allow it; the log reports the result. 0 to 99, 0: none. With hardware,
  /// memory is locked as well.
  int realtime_priority = regulator::kRealtimePriority;

  /// @throws ParameterError with every fault.
  static PressureCommandOptions load();
};

}  // namespace helix_arm::ros_bridge
