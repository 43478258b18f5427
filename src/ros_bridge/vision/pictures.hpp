#pragma once

#include <chrono>
#include <cstdint>
#include <optional>
#include <string>
#include <utility>
#include <variant>
#include <vector>

#include <opencv2/core.hpp>
#include <ros/time.h>
#include <sensor_msgs/CameraInfo.h>
#include <sensor_msgs/CompressedImage.h>
#include <sensor_msgs/Image.h>

#include "basics/mutex.hpp"
#include "helix_arm/basics/requirement.hpp"
#include "helix_arm/localization/body_check.hpp"
#include "helix_arm/localization/camera.hpp"
#include "vision/jpeg.hpp"

/// Pictures and cameras: conversion between messages and values, and the handover of pictures to
/// the thread that measures. Messages are checked here; no other code trusts them.
namespace helix_arm::ros_bridge {

/// Why a picture, a camera_info, a model or a pose was refused.
enum class PictureFault {
  kBadJpeg,
  kWrongEncoding,
  kWrongSize,
  kBadCameraInfo,
  kBadModel,
  kSource,
  kBadPose,
};
inline constexpr int kPictureFaultCount = 7;

/// Name of a fault, as the fields of VisionStatus have it: `bad_jpeg`, `wrong_encoding`, ...
const char* nameOf(PictureFault fault);

using PictureRefusal = basics::Refusal<PictureFault>;

/// Content of a message, or why it was refused.
template <class T>
using CheckedPicture = basics::Checked<T, PictureFault>;

/// The picture in gray (CV_8UC1): mono8 as it is, without a copy, so valid as long as the message;
/// bgr8, rgb8, bgra8, rgba8 and 8-bit Bayer patterns converted into `buffer`.
CheckedPicture<cv::Mat> fromMsg(const sensor_msgs::Image& image, cv::Mat& buffer);

/// The picture in gray, decoded into `buffer`.
CheckedPicture<cv::Mat> fromMsg(const sensor_msgs::CompressedImage& image,
                                vision::JpegDecoder& decoder, cv::Mat& buffer);

/// Intrinsics of a camera_info; an uncalibrated one (K = 0) is refused.
CheckedPicture<estimation::Camera> fromMsg(const sensor_msgs::CameraInfo& info);

/// plumb_bob, or rational_polynomial where the camera needs k4 to k6.
sensor_msgs::CameraInfo toCameraInfoMsg(const std_msgs::Header& header,
                                        const estimation::Camera& camera);

/// A picture of type CV_8UC1 (mono8) or CV_8UC3 (bgr8).
sensor_msgs::Image toImageMsg(const std_msgs::Header& header, const cv::Mat& picture);

/// True when both see the same in the same places.
bool equal(const estimation::Camera& a, const estimation::Camera& b);

/// `1280 x 720`.
std::string sizeText(std::int64_t width, std::int64_t height);

/// Poses of bodies at one time.
struct BodySet {
  std::vector<estimation::BodyPose> poses;
  std::string frame;  ///< in which they are seen
};

/// A picture as it came, not decoded yet; or poses in place of one.
struct Picture {
  ros::Time stamp;
  /// A cv::Mat is gray (CV_8UC1) and owns its memory.
  std::variant<sensor_msgs::ImageConstPtr, sensor_msgs::CompressedImageConstPtr, cv::Mat, BodySet>
      content;
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
