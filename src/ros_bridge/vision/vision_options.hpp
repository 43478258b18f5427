#pragma once

#include <string>

#include <ros/node_handle.h>

namespace helix_arm::ros_bridge {

/// Private parameters of vision.
struct VisionOptions {
  std::string scene;  ///< ~scene: as pressure_command's; required
  /// ~scene_folder: folder from which ~reload takes scenes, besides the package's and ~scene;
  /// `helix_arm` below ROS_HOME by default.
  std::string scene_folder;
  /// ~source: `topic` (image and image/compressed, whichever speaks first), one of these two alone,
  /// `webcam` (the scene's camera.webcam), or the path of a video, picture or folder.
  std::string source = "topic";
  bool use_camera_info = true;  ///< ~use_camera_info: if false, the scene's intrinsics hold
  std::string camera_info_url;  ///< ~camera_info_url: calibration of a webcam or file
  double file_rate = 15.0;      ///< ~file_rate: picture rate of a file, 0.1 to 1000 [Hz]
  double draw_rate = 20.0;      ///< ~draw_rate: maximum of markers and overlay, 0.1 to 100 [Hz]
  double stale_after = 1.0;     ///< ~stale_after_s: time without pictures, 0.05 to 60 [s]
  /// ~publish_image: the pictures of a webcam or file also on image, with camera_info.
  bool publish_image = false;
  int frames = 5;            ///< ~frames: measured_0 .. measured_(frames - 1), 2 to 1000
  std::string world_frame;   ///< ~world_frame: "world"
  std::string frame_prefix;  ///< ~frame_prefix: "", set before arm_base and measured_*
  bool optional = false;     ///< ~optional: a scene without camera or tags is no fault

  /// @throws ParameterError with every fault.
  static VisionOptions load(const ros::NodeHandle& private_node);

  /// Pictures come from the scene's webcam.
  bool fromWebcam() const;
  /// Pictures come from a video, a picture or a folder.
  bool fromFile() const;
  /// Pictures come from this topic: names::kImage or names::kCompressedImage.
  bool fromTopic(const std::string& topic) const;

  /// Name of the camera's frame, with the prefix.
  std::string cameraFrame() const;
};

}  // namespace helix_arm::ros_bridge
