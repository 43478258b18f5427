#pragma once

#include <string>

namespace helix_arm::ros_bridge {

/// Private parameters of visual_servo.
struct VisualServoOptions {
  std::string scene;  ///< ~scene: as pressure_command's; required
  /// ~scene_folder: folder from which ~reload takes scenes, besides the package's and ~scene;
  /// `helix_arm` below ROS_HOME by default.
  std::string scene_folder;
  double rate = 50.0;        ///< ~rate: maximum of loop_status and estimate, 1 to 1000 [Hz]
  double draw_rate = 20.0;   ///< ~draw_rate: of the markers, 0.1 to 100 [Hz]
  std::string frame_prefix;  ///< ~frame_prefix: "", set before arm_base
  bool handle = true;        ///< ~handle: show the interactive marker

  /// @throws ParameterError with every fault.
  static VisualServoOptions load();
};

}  // namespace helix_arm::ros_bridge
