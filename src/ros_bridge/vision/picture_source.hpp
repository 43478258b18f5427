#pragma once

#include <chrono>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <variant>

#include <camera_info_manager/camera_info_manager.h>
#include <opencv2/core.hpp>
#include <ros/node_handle.h>
#include <ros/time.h>
#include <sensor_msgs/CameraInfo.h>
#include <sensor_msgs/CompressedImage.h>
#include <sensor_msgs/Image.h>

#include "helix_arm/basics/mutex.hpp"
#include "helix_arm/control/commander_lease.hpp"
#include "helix_arm/io/scene.hpp"
#include "helix_arm/vision/frame_source.hpp"
#include "pictures.hpp"
#include "ros_bridge/common/diagnostics.hpp"
#include "ros_bridge/common/run_node.hpp"
#include "vision_options.hpp"
#include "vision_status_publisher.hpp"

namespace helix_arm::ros_bridge {

/// A picture as it came, not decoded yet.
struct Picture {
  ros::Time stamp;
  /// A cv::Mat is gray (CV_8UC1) and owns its memory.
  std::variant<sensor_msgs::ImageConstPtr, sensor_msgs::CompressedImageConstPtr, cv::Mat> content;
};

/// Hands pictures from the threads that get them to the one that measures. It holds one picture: a
/// newer one replaces one that waits. From any thread.
class PictureMailbox {
 public:
  /// @return true when a picture waited, which this one has replaced.
  bool put(Picture picture) HELIX_ARM_EXCLUDES(mutex_);

  /// Waits for a picture. From then on the taker is busy, until done().
  /// @return nothing once the mailbox is stopped.
  std::optional<Picture> take() HELIX_ARM_EXCLUDES(mutex_);
  void done() HELIX_ARM_EXCLUDES(mutex_);

  /// Waits until no picture waits and the taker is not busy.
  /// @return false once the mailbox is stopped.
  bool waitUntilIdle() HELIX_ARM_EXCLUDES(mutex_);
  /// @return false once the mailbox is stopped, at once.
  bool sleepUntil(std::chrono::steady_clock::time_point due) HELIX_ARM_EXCLUDES(mutex_);

  /// Ends all waits, and those to come.
  void stop() HELIX_ARM_EXCLUDES(mutex_);
  bool stopped() const HELIX_ARM_EXCLUDES(mutex_);

 private:
  mutable basics::Mutex mutex_;
  basics::Condition changed_;  ///< something guarded by mutex_ has changed
  bool stop_ HELIX_ARM_GUARDED_BY(mutex_) = false;
  bool busy_ HELIX_ARM_GUARDED_BY(mutex_) = false;  ///< the last picture taken is not done
  std::optional<Picture> next_ HELIX_ARM_GUARDED_BY(mutex_);
};

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
