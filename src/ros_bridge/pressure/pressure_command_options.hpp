#pragma once

#include <algorithm>
#include <string>

#include <ros/node_handle.h>

#include "helix_arm/regulator/realtime.hpp"
#include "ros_bridge/common/parameters.hpp"
#include "ros_bridge/names.hpp"

namespace helix_arm::ros_bridge {

/// Private parameters of pressure_command.
struct PressureCommandOptions {
  ParameterReader reader{ros::NodeHandle("~")};
  std::string scene = reader.file("scene", "config/scenes", ".yaml");
  double rate = reader.number("rate", 100.0, {1.0, 1000.0});  ///< of the loop [Hz]
  /// Rate of the moving frames, at most the loop's [Hz].
  double tf_rate = std::min(rate, reader.number("tf_rate", 100.0, {0.1, 1000.0}));
  double draw_rate = reader.number("draw_rate", 20.0, {0.1, 100.0});  ///< of the markers [Hz]
  int frames = reader.count("frames", 5, 2, 1000);  ///< on the curve: model_0 .. model_(frames - 1)
  std::string world_frame = reader.frame("world_frame", names::kWorldFrame);
  std::string frame_prefix = reader.frame("frame_prefix", "");  ///< of arm_base and model_*
  bool handle = reader.flag("handle", true);                    ///< show the interactive marker
  /// `scene` drives the scene's regulator, hardware or simulated, from this node; `topic` leaves
  /// the pressures to another node, which reports them on pressure_measured.
  std::string regulator = reader.choice("regulator", "scene", {"scene", "topic"});
  /// A target enables the arm, first and after commander or regulator fell silent; never hardware.
  bool auto_enable = reader.flag("auto_enable", regulator == "scene");
  /// Drive hardware although ROS time is simulated; the safety rules run on the steady clock.
  bool allow_sim_time = reader.flag("allow_sim_time", false);
  /// Priority (SCHED_FIFO) of the threads between targets and valves, and of the guard, if the
  /// user's limits allow it; the log reports the result. 0: none. With hardware, memory is locked
  /// as well.
  int realtime_priority = reader.count("realtime_priority", regulator::kRealtimePriority, 0,
                                       regulator::kHighestRealtimePriority);
  /// Folder from which ~reload accepts scenes, besides those of the package and ~scene.
  std::string scene_folder = reader.folder("scene_folder", defaultFolder());

  PressureCommandOptions() { reader.finish(); }
};

}  // namespace helix_arm::ros_bridge
