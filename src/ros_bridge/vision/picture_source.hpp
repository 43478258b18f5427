#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>

#include <camera_info_manager/camera_info_manager.h>
#include <ros/node_handle.h>
#include <ros/time.h>

#include "helix_arm/basics/mutex.hpp"
#include "helix_arm/control/commander_lease.hpp"
#include "helix_arm/io/scene.hpp"
#include "helix_arm/vision/frame_source.hpp"
#include "observations.hpp"
#include "pose_source.hpp"
#include "ros_bridge/common/parameters.hpp"
#include "ros_bridge/common/run_node.hpp"
#include "ros_bridge/names.hpp"

namespace helix_arm::ros_bridge {

/// Value of ~source: one of these words, or the absolute path of a video, picture or folder.
inline constexpr char kTopicSource[] = "topic", kWebcamSource[] = "webcam", kPoseSource[] = "poses";
std::string readSource(ParameterReader& reader);
/// `~tf`, `~topics` and `~together_s`.
PoseOptions readPoses(ParameterReader& reader);

/// Private parameters of vision.
struct VisionOptions {
  ParameterReader reader;
  std::string scene = reader.file("scene", "config/scenes", ".yaml");  ///< as pressure_command's
  /// `topic` (image and image/compressed, whichever speaks first), one of these two alone, `webcam`
  /// (the scene's camera.webcam), or the path of a video, picture or folder; `poses` of the scene's
  /// motion-capture bodies.
  std::string source = readSource(reader);
  PoseOptions poses = readPoses(reader);
  bool use_camera_info = reader.flag("use_camera_info", true);  ///< else the scene's intrinsics
  std::string camera_info_url = reader.text("camera_info_url", "");    ///< of a webcam or file
  double file_rate = reader.number("file_rate", 15.0, {0.1, 1000.0});  ///< pictures of a file [Hz]
  double draw_rate = reader.number("draw_rate", 20.0, {0.1, 100.0});   ///< of markers, overlay [Hz]
  double stale_after = reader.number("stale_after_s", 1.0, {0.05, 60.0});  ///< without pictures [s]
  /// The pictures of a webcam or file also on image, with camera_info.
  bool publish_image = reader.flag("publish_image", false);
  int frames = reader.count("frames", 5, 2, 1000);  ///< measured_0 .. measured_(frames - 1)
  std::string world_frame = reader.frame("world_frame", names::kWorldFrame);
  std::string frame_prefix = reader.frame("frame_prefix", "");  ///< of arm_base and measured_*
  bool optional = reader.flag("optional", false);  ///< a scene without camera or tags is no fault
  /// Folder from which ~reload takes scenes, besides the package's and ~scene.
  std::string scene_folder = reader.folder("scene_folder", defaultFolder());

  explicit VisionOptions(const ros::NodeHandle& private_node) : reader(private_node) {
    reader.finish();
  }

  /// Poses of bodies come in place of pictures.
  bool fromBodies() const { return source == kPoseSource; }
  /// Pictures come from the scene's webcam.
  bool fromWebcam() const { return source == kWebcamSource; }
  /// Pictures come from a video, a picture or a folder.
  bool fromFile() const { return source.compare(0, 1, "/") == 0; }
  /// Pictures come from this topic: names::kImage or names::kCompressedImage.
  bool fromTopic(const std::string& topic) const {
    return source == kTopicSource || source == topic;
  }
  /// Name of the camera's frame, with the prefix.
  std::string cameraFrame() const { return frame_prefix + names::kCameraFrame; }
};

/// Where pictures and the camera's calibration come from: the topics image, image/compressed and
/// camera_info, or a webcam or file, read by a thread of its own. Or poses of bodies: PoseSource.
///
/// The first of two picture topics to speak is used until it is silent for
/// VisionOptions::stale_after. The latest picture replaces one that waits to be taken; files are
/// read at the pace of the taker. A picture stamped 0 is stamped on arrival, with a warning.
class PictureSource {
 public:
  /// Subscribes; reads no picture of a webcam or file before start().
  /// @param status  is told of arrivals and faults; outlives this.
  /// @throws std::invalid_argument on a source that cannot be opened or calibrated.
  PictureSource(ros::NodeHandle& node, const VisionOptions& options, const io::Scene& scene,
                VisionStatusPublisher& status);
  /// Stops, and waits for the thread to end.
  ~PictureSource();

  /// Starts the thread of a webcam or file; does nothing for topics.
  /// @param on_failure  called by the thread, last of all, if it failed.
  void start(std::function<void()> on_failure);
  /// From any thread: take() gives no more pictures, and the thread ends.
  void stop() { mailbox_.stop(); }
  void join() { capturer_.join(); }
  /// Exit code of the thread: kDone unless it failed.
  int verdict() const { return capturer_.verdict(); }

  /// Waits for the next picture, to be followed by done(). For one thread.
  /// @return nothing once stopped.
  std::optional<Picture> take() { return mailbox_.take(); }
  void done() { mailbox_.done(); }

  /// The last camera_info, or the calibration of ~camera_info_url; nothing where none came, so that
  /// the scene's intrinsics hold. From any thread.
  std::optional<CheckedPicture<estimation::Camera>> cameraInfo() const HELIX_ARM_EXCLUDES(mutex_);

  /// The topic of rectified pictures by its name, as that of image_proc; empty if none is. From any
  /// thread.
  const std::string& rectifiedTopic() const { return rectified_; }

  /// Number of nodes that publish pictures on a topic. From any thread.
  std::uint32_t publishers() const;
  /// Number of nodes that publish camera_info. From any thread.
  std::uint32_t infoPublishers() const { return info_subscriber_.getNumPublishers(); }

 private:
  // Callbacks.
  void onImage(const sensor_msgs::ImageConstPtr& image);
  void onCompressed(const sensor_msgs::CompressedImageConstPtr& image);
  void onCameraInfo(const sensor_msgs::CameraInfoConstPtr& info) HELIX_ARM_EXCLUDES(mutex_);

  template <class Message>
  void onPicture(const boost::shared_ptr<const Message>& picture, const char* topic);

  // Thread of the webcam or file.
  void capture() HELIX_ARM_EXCLUDES(mutex_);

  // From callbacks, or from the thread of the webcam or file.
  void arrived(Picture picture);

  const VisionOptions options_;
  VisionStatusPublisher& status_;
  std::string rectified_;
  PictureMailbox mailbox_;

  // Used by callbacks only.
  control::CommanderLease lease_;  ///< which of the two picture topics is listened to
  FaultCount unstamped_;

  // Used by the thread of the webcam or file only; null with topics.
  std::unique_ptr<vision::FrameSource> frames_;
  std::unique_ptr<camera_info_manager::CameraInfoManager> calibration_;

  mutable basics::Mutex mutex_;
  std::optional<CheckedPicture<estimation::Camera>> camera_info_ HELIX_ARM_GUARDED_BY(mutex_);

  std::optional<PoseSource> poses_;  ///< used by callbacks only
  ros::Subscriber image_subscriber_, compressed_subscriber_, info_subscriber_;
  GuardedThread capturer_;
};

}  // namespace helix_arm::ros_bridge
