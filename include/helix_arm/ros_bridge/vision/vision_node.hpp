#pragma once

#include <chrono>
#include <condition_variable>
#include <cstdint>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <variant>

#include <camera_info_manager/camera_info_manager.h>
#include <ros/node_handle.h>
#include <ros/steady_timer.h>
#include <tf2_ros/static_transform_broadcaster.h>
#include <tf2_ros/transform_broadcaster.h>

#include "helix_arm/ArmShape.h"
#include "helix_arm/control/commander_lease.hpp"
#include "helix_arm/io/scene.hpp"
#include "helix_arm/ros_bridge/common/arm_frames.hpp"
#include "helix_arm/ros_bridge/common/guarded_callbacks.hpp"
#include "helix_arm/ros_bridge/common/guarded_thread.hpp"
#include "helix_arm/ros_bridge/common/model_history.hpp"
#include "helix_arm/ros_bridge/common/reload_server.hpp"
#include "helix_arm/ros_bridge/vision/pictures.hpp"
#include "helix_arm/ros_bridge/vision/vision_ledger.hpp"
#include "helix_arm/ros_bridge/vision/vision_markers.hpp"

namespace helix_arm::ros_bridge {

/// Private parameters of vision.
struct VisionOptions {
  std::string scene;  ///< ~scene: as pressure_command's; required
  /// ~scene_folder: below which ~reload takes scenes, beside those of the package and ~scene;
  /// `helix_arm` below ROS_HOME by default.
  std::string scene_folder;
  /// ~source: `topic` (image and image/compressed, whichever speaks first), one of these two alone,
  /// `webcam` (the scene's camera.webcam), or the absolute path of a video, picture or folder.
  std::string source = "topic";
  bool use_camera_info = true;  ///< ~use_camera_info: else the scene's intrinsics hold
  std::string camera_info_url;  ///< ~camera_info_url: of a webcam's or file's calibration
  double file_rate = 15.0;      ///< ~file_rate: of a file's pictures, 0.1 to 1000 [Hz]
  double draw_rate = 20.0;      ///< ~draw_rate: markers and overlay at most, 0.1 to 100 [Hz]
  double stale_after = 1.0;     ///< ~stale_after_s: without pictures, 0.05 to 60 [s]
  int frames = 5;               ///< ~frames: measured_0 .. measured_(frames - 1), 2 to 1000
  std::string world_frame;      ///< ~world_frame: "world"
  std::string frame_prefix;     ///< ~frame_prefix: "", set before arm_base and measured_*
  bool optional = false;        ///< ~optional: a scene without camera or tags is no fault

  /// @throws ParameterError with every fault.
  static VisionOptions load(const ros::NodeHandle& private_node);
};

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
/// - measured_markers (visualization_msgs/MarkerArray): see VisionMarkers; deleted when the state
/// is
///   no longer `measured`
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
/// The latest picture wins: those that come while one is worked on are overtaken and counted; files
/// are read at the pace of the work. A bad picture or camera_info is counted, warned of once in a
/// while and told on vision_status; it never makes a measurement. A picture stamped 0 is stamped on
/// arrival, with a warning. One stamped before the last one is a jump back in time: nothing from
/// before it is used. Whether pictures still come is judged by a steady clock, all else by stamps.
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
  struct Picture {
    ros::Time stamp;
    std::variant<sensor_msgs::ImageConstPtr, sensor_msgs::CompressedImageConstPtr, cv::Mat> content;
  };

  /// A scene and what looks for its tags.
  struct Eyes {
    io::Scene scene;
    std::unique_ptr<vision::ArmLocalizer> localizer;
  };

  // Callbacks.
  void onImage(const sensor_msgs::ImageConstPtr& image);
  void onCompressed(const sensor_msgs::CompressedImageConstPtr& image);
  void onCameraInfo(const sensor_msgs::CameraInfoConstPtr& info);
  void onModel(const ArmShapeConstPtr& model);
  void onWatch(const ros::SteadyTimerEvent& event);
  void onSecond(const ros::SteadyTimerEvent& event);
  void adopt(io::Scene next);

  // In the thread that failed.
  void onFailure();

  // Thread of the webcam or file.
  void capture();

  template <class Message>
  void onPicture(const boost::shared_ptr<const Message>& picture, const char* topic);
  void arrived(Picture picture);
  // Nodes that publish the pictures' topics or camera_info.
  std::uint32_t publishers() const;

  // Thread of the measurements.
  void work();
  void measure(const Picture& picture);
  Taken<cv::Mat> decode(const Picture& picture);
  /// The picture, of the size of the camera that it adopts.
  Taken<cv::Mat> take(const Picture& picture);
  std::optional<PictureRefusal> adoptCamera(const cv::Size& size);
  std::optional<ModelHistory::Entry> modelAt(const ros::Time& stamp);
  void publish(const ros::Time& stamp, const cv::Mat& gray, const vision::Sight& sight,
               const std::optional<ModelHistory::Entry>& model);

  // With mutex_ locked.
  void refuse(const PictureRefusal& refusal);
  void enter(std::uint8_t state, const std::string& message);
  void publishStatus();

  const Host host_;
  const VisionOptions options_;
  const std::string name_;  ///< of the node
  const FrameNames frames_;
  const VisionMarkers markers_;
  io::Scene rig_;  ///< as the callbacks know it: the last scene that was loaded

  // Of the thread of the measurements alone.
  Eyes eyes_;
  vision::JpegDecoder decoder_;
  cv::Mat buffer_;
  model::Shape prior_;
  ros::Time last_stamp_, last_tf_stamp_;
  ros::SteadyTime last_drawing_;
  FaultCount jumps_, adoptions_, late_models_, far_stamps_;
  FaultGuard picture_guard_{"a picture"};
  std::string whose_calibration_;  ///< whose intrinsics hold
  std::chrono::milliseconds patience_;

  // Of the thread of the pictures alone.
  std::unique_ptr<vision::FrameSource> source_;
  std::unique_ptr<camera_info_manager::CameraInfoManager> calibration_;

  std::mutex mutex_;  ///< of all below, up to the publishers
  std::condition_variable wake_;
  bool stop_ = false;
  std::optional<Picture> next_;
  std::optional<Eyes> next_eyes_;
  bool busy_ = false;          ///< a picture is being measured in
  bool source_fault_ = false;  ///< of the webcam or file, last time
  FaultCount unstamped_;
  std::optional<Taken<estimation::Camera>> camera_info_;  ///< the last one
  ModelHistory models_;
  VisionLedger ledger_;
  control::CommanderLease lease_;  ///< which of the two picture topics is listened to
  ros::SteadyTime last_arrival_;
  ros::SteadyTime last_report_;

  ros::NodeHandle node_;
  ros::Publisher measured_publisher_, detections_publisher_, error_publisher_, status_publisher_;
  ros::Publisher overlay_publisher_, marker_publisher_, diagnostics_publisher_;
  tf2_ros::TransformBroadcaster tf_;
  tf2_ros::StaticTransformBroadcaster static_tf_;
  ros::Subscriber image_subscriber_, compressed_subscriber_, info_subscriber_, model_subscriber_;
  std::unique_ptr<ReloadServer> reload_;
  ros::SteadyTimer watch_timer_, second_timer_;
  GuardedThread worker_, capturer_;
};

}  // namespace helix_arm::ros_bridge
