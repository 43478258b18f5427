#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <optional>

#include <camera_info_manager/camera_info_manager.h>
#include <ros/node_handle.h>
#include <sensor_msgs/CameraInfo.h>
#include <sensor_msgs/CompressedImage.h>
#include <sensor_msgs/Image.h>

#include "helix_arm/basics/mutex.hpp"
#include "helix_arm/control/commander_lease.hpp"
#include "helix_arm/io/scene.hpp"
#include "helix_arm/vision/frame_source.hpp"
#include "ros_bridge/common/diagnostics.hpp"
#include "ros_bridge/common/guarded_thread.hpp"
#include "ros_bridge/vision/picture_mailbox.hpp"
#include "ros_bridge/vision/pictures.hpp"
#include "ros_bridge/vision/vision_options.hpp"
#include "ros_bridge/vision/vision_status_publisher.hpp"

namespace helix_arm::ros_bridge {

/// Where pictures and the camera's calibration come from: the topics image, image/compressed and
/// camera_info, or a webcam or file, read by a thread of its own.
///
/// Of two picture topics the first to speak is used until it is silent for
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
  void stop();
  void join();
  /// Exit code of the thread: kDone unless it failed.
  int verdict() const { return capturer_.verdict(); }

  /// Waits for the next picture, to be followed by done(). For one thread.
  /// @return nothing once stopped.
  std::optional<Picture> take() { return mailbox_.take(); }
  void done() { mailbox_.done(); }

  /// The last camera_info, or the calibration of ~camera_info_url; nothing where none came, so that
  /// the scene's intrinsics hold. From any thread.
  std::optional<CheckedPicture<estimation::Camera>> cameraInfo() const HELIX_ARM_EXCLUDES(mutex_);

  /// Number of nodes that publish pictures on a topic. From any thread.
  std::uint32_t publishers() const;
  /// Number of nodes that publish camera_info. From any thread.
  std::uint32_t infoPublishers() const;

 private:
  // Callbacks.
  void onImage(const sensor_msgs::ImageConstPtr& image);
  void onCompressed(const sensor_msgs::CompressedImageConstPtr& image);
  void onCameraInfo(const sensor_msgs::CameraInfoConstPtr& info) HELIX_ARM_EXCLUDES(mutex_);
  template <class Message>
  void onPicture(const boost::shared_ptr<const Message>& picture, const char* topic);

  // Thread of the webcam or file.
  void capture() HELIX_ARM_EXCLUDES(mutex_);
  bool pauseAfterFault(double retry_after);

  // From callbacks, or from the thread of the webcam or file.
  void arrived(Picture picture);

  const VisionOptions options_;
  VisionStatusPublisher& status_;
  PictureMailbox mailbox_;

  // Used by callbacks only.
  control::CommanderLease lease_;  ///< which of the two picture topics is listened to
  FaultCount unstamped_;

  // Used by the thread of the webcam or file only; null with topics.
  std::unique_ptr<vision::FrameSource> frames_;
  std::unique_ptr<camera_info_manager::CameraInfoManager> calibration_;

  mutable basics::Mutex mutex_;
  std::optional<CheckedPicture<estimation::Camera>> camera_info_
      HELIX_ARM_GUARDED_BY(mutex_);  ///< the last

  ros::Subscriber image_subscriber_, compressed_subscriber_, info_subscriber_;
  GuardedThread capturer_;
};

}  // namespace helix_arm::ros_bridge
