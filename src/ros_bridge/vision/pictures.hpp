#pragma once

#include <cstdint>
#include <string>

#include <opencv2/core.hpp>
#include <sensor_msgs/CameraInfo.h>
#include <sensor_msgs/CompressedImage.h>
#include <sensor_msgs/Image.h>

#include "helix_arm/basics/requirement.hpp"
#include "helix_arm/localization/camera.hpp"
#include "helix_arm/vision/jpeg.hpp"

/// Conversion of pictures and cameras between messages and values. Messages are checked here; no
/// other code trusts them.
namespace helix_arm::ros_bridge {

/// Why a picture, a camera_info or a model was refused.
enum class PictureFault {
  kBadJpeg,
  kWrongEncoding,
  kWrongSize,
  kBadCameraInfo,
  kBadModel,
  kSource,
};
inline constexpr int kPictureFaultCount = 6;

/// Name of a fault, as the fields of VisionStatus have it: `bad_jpeg`, `wrong_encoding`, ...
const char* nameOf(PictureFault fault);

/// Name of a state of VisionStatus: `measured`, `few_tags`, ...
const char* nameOfState(std::uint8_t state);

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

}  // namespace helix_arm::ros_bridge
