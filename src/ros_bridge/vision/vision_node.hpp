#pragma once

#include <memory>
#include <string>

#include <ros/node_handle.h>
#include <ros/steady_timer.h>
#include <tf2_ros/static_transform_broadcaster.h>

#include "helix_arm/ArmShape.h"
#include "helix_arm/io/scene.hpp"
#include "measurement_publisher.hpp"
#include "picture_measurer.hpp"
#include "picture_source.hpp"
#include "ros_bridge/common/arm_frames.hpp"
#include "ros_bridge/common/guarded_callbacks.hpp"
#include "ros_bridge/common/reload_server.hpp"
#include "ros_bridge/common/run_node.hpp"
#include "vision_options.hpp"
#include "vision_status_publisher.hpp"

namespace helix_arm::ros_bridge {

/// Measures the shape of a scene's arm from pictures of its tags, and compares the model with it.
///
/// Subscribes
/// - image (sensor_msgs/Image; mono8, bgr8, rgb8, bgra8, rgba8, 8-bit Bayer) and image/compressed
///   (sensor_msgs/CompressedImage; JPEG), according to ~source
/// - camera_info (sensor_msgs/CameraInfo): intrinsics in place of the scene's; an uncalibrated one
///   is refused, and nothing is measured until a sound one comes
/// - model (ArmShape): where to expect the tags, and what to compare with
///
/// Publishes
/// - measured (ArmShape, tier `measured`, with covariance): stamped like its picture
/// - tag_detections (TagDetections): of each picture, measured in or not
/// - model_error (ModelError): with each measurement that has a model of its time
/// - vision_status (VisionStatus): at every change of state, and once a second
/// - overlay (sensor_msgs/Image, bgr8): while someone subscribes to it
/// - with ~publish_image: image (sensor_msgs/Image, mono8) and camera_info, the pictures of a
/// webcam
///   or file with the intrinsics that they are measured with: each while someone subscribes to it
/// - measured_markers (visualization_msgs/MarkerArray): see VisionMarkers; deleted when the state
///   is no longer `measured`
/// - /diagnostics (diagnostic_msgs/DiagnosticArray): `<node>: camera`, `<node>: measurement`, 1 Hz
/// - tf: arm_base -> measured_0 .. measured_(n-1) and measured_tip, stamped like the picture;
///   world -> camera_optical (static)
///
/// Service
/// - ~reload (Reload): another file of the same rig, from the next picture on; ~source and the
///   settings of a webcam stay
///
/// Parameters: VisionOptions.
///
/// A picture that comes while one is measured waits; a newer one replaces it, and this is counted.
/// Files are read at the pace of the measurements. A bad picture or camera_info is counted, warned
/// of at a limited rate and reported on vision_status; it never makes a measurement. A picture
/// stamped 0 is stamped on arrival, with a warning. One stamped before the last one is a jump back
/// in time: nothing from before it is used. A steady clock decides whether pictures still come; all
/// else goes by stamps.
///
/// Ends with 0 when asked to, or where ~optional is set and there is nothing to see; 1 when the ROS
/// master is lost; 2 on a bad scene or parameter.
class VisionNode {
 public:
  /// Whose process it lives in: a fault in its threads ends its own, but not a nodelet manager's.
  enum class Host { kOwnProcess, kManager };

  /// @param node          where topics are relative to.
  /// @param private_node  where parameters are; names the node in diagnostics.
  /// @throws io::DocumentError, ParameterError or std::invalid_argument with every fault found;
  /// NothingToDo.
  explicit VisionNode(const ros::NodeHandle& node = ros::NodeHandle(),
                      const ros::NodeHandle& private_node = ros::NodeHandle("~"),
                      Host host = Host::kOwnProcess);
  ~VisionNode();

  int finish() const;

 private:
  // Callbacks.
  void onModel(const ArmShapeConstPtr& model);
  void onWatch(const ros::SteadyTimerEvent& event);
  void onSecond(const ros::SteadyTimerEvent& event);
  void adopt(io::Scene next);
  void sendCameraFrame();

  // In the thread that failed.
  void onFailure();

  // Thread of the measurements.
  void work();
  void measure(const Picture& picture);

  /// From any thread: ends the threads, and all waits.
  void stop();
  /// Stops, and waits for the threads to end.
  void end();

  const Host host_;
  const VisionOptions options_;
  const std::string name_;  ///< of the node
  const FrameNames frames_;

  // Used by callbacks only.
  io::Scene scene_;  ///< the last one loaded
  ros::NodeHandle node_;
  tf2_ros::StaticTransformBroadcaster static_tf_;

  // A picture passes from source_ through measurer_, which asks models_, to publisher_.
  VisionStatusPublisher status_;    ///< from any thread
  PictureSource source_;            ///< locks what its threads share
  ModelMatcher models_;             ///< locks what its threads share
  PictureMeasurer measurer_;        ///< used by the thread of the measurements, except adopt()
  MeasurementPublisher publisher_;  ///< used by the thread of the measurements only
  FaultGuard picture_guard_{"a picture"};

  ros::Subscriber model_subscriber_;
  std::unique_ptr<ReloadServer> reload_;
  ros::SteadyTimer watch_timer_, second_timer_;
  GuardedThread worker_;  ///< the thread of the measurements
};

}  // namespace helix_arm::ros_bridge
