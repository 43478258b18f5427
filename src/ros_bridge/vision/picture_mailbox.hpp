#pragma once

#include <chrono>
#include <optional>
#include <utility>
#include <variant>

#include <opencv2/core.hpp>
#include <ros/time.h>
#include <sensor_msgs/CompressedImage.h>
#include <sensor_msgs/Image.h>

#include "helix_arm/basics/mutex.hpp"

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
  bool put(Picture picture) HELIX_ARM_EXCLUDES(mutex_) {
    const basics::MutexLock lock(mutex_);
    const bool replaces = next_.has_value();
    next_ = std::move(picture);
    changed_.notifyAll();
    return replaces;
  }

  /// Waits for a picture. From then on the taker is busy, until done().
  /// @return nothing once the mailbox is stopped.
  std::optional<Picture> take() HELIX_ARM_EXCLUDES(mutex_) {
    basics::MutexLock lock(mutex_);
    changed_.wait(lock, [this]() HELIX_ARM_REQUIRES(mutex_) { return stop_ || next_; });
    if (stop_) return std::nullopt;
    busy_ = true;
    return std::exchange(next_, std::nullopt);
  }
  void done() HELIX_ARM_EXCLUDES(mutex_) {
    const basics::MutexLock lock(mutex_);
    busy_ = false;
    changed_.notifyAll();
  }

  /// Waits until no picture waits and the taker is not busy.
  /// @return false once the mailbox is stopped.
  bool waitUntilIdle() HELIX_ARM_EXCLUDES(mutex_) {
    basics::MutexLock lock(mutex_);
    changed_.wait(lock,
                  [this]() HELIX_ARM_REQUIRES(mutex_) { return stop_ || (!next_ && !busy_); });
    return !stop_;
  }
  /// @return false once the mailbox is stopped, at once.
  bool sleepUntil(std::chrono::steady_clock::time_point due) HELIX_ARM_EXCLUDES(mutex_) {
    basics::MutexLock lock(mutex_);
    return !changed_.waitUntil(lock, due, [this]() HELIX_ARM_REQUIRES(mutex_) { return stop_; });
  }

  /// Ends all waits, and those to come.
  void stop() HELIX_ARM_EXCLUDES(mutex_) {
    const basics::MutexLock lock(mutex_);
    stop_ = true;
    changed_.notifyAll();
  }
  bool stopped() const HELIX_ARM_EXCLUDES(mutex_) {
    const basics::MutexLock lock(mutex_);
    return stop_;
  }

 private:
  mutable basics::Mutex mutex_;
  basics::Condition changed_;  ///< something guarded by mutex_ has changed
  bool stop_ HELIX_ARM_GUARDED_BY(mutex_) = false;
  bool busy_ HELIX_ARM_GUARDED_BY(mutex_) = false;  ///< the last picture taken is not done
  std::optional<Picture> next_ HELIX_ARM_GUARDED_BY(mutex_);
};

}  // namespace helix_arm::ros_bridge
