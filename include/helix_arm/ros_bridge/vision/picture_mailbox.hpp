#pragma once

#include <chrono>
#include <condition_variable>
#include <mutex>
#include <optional>
#include <variant>

#include <opencv2/core.hpp>
#include <ros/time.h>
#include <sensor_msgs/CompressedImage.h>
#include <sensor_msgs/Image.h>

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
  bool put(Picture picture);

  /// Waits for a picture. From then on the taker is busy, until done().
  /// @return nothing once the mailbox is stopped.
  std::optional<Picture> take();
  void done();

  /// Waits until no picture waits and the taker is not busy.
  /// @return false once the mailbox is stopped.
  bool waitUntilIdle();
  /// @return false once the mailbox is stopped, at once.
  bool sleepUntil(std::chrono::steady_clock::time_point due);

  /// Ends all waits, and those to come.
  void stop();
  bool stopped() const;

 private:
  mutable std::mutex mutex_;
  std::condition_variable changed_;  ///< with mutex_: something guarded by it has changed
  bool stop_ = false;                ///< guarded by mutex_
  bool busy_ = false;                ///< guarded by mutex_: the last picture taken is not done
  std::optional<Picture> next_;      ///< guarded by mutex_
};

}  // namespace helix_arm::ros_bridge
