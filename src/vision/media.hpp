#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <string>

#include <opencv2/core.hpp>

#include "helix_arm/vision/frame_source.hpp"

namespace helix_arm::vision {

/// What OpenCV's videoio and imgcodecs read: webcams, videos, and pictures other than JPEG and PNG.
/// They bring 200 shared libraries, so that they are in a library that the first use loads.
struct Media {
  std::unique_ptr<VideoDevice> (*webcam)(const WebcamConfig& config);
  /// See FrameSource::files().
  std::unique_ptr<FrameSource> (*video)(const std::string& path,
                                        const std::optional<cv::Size>& expected);
  /// @param gray  (CV_8UC1) set on success. @return the fault; absent on success.
  std::optional<std::string> (*decode)(const std::string& bytes, cv::Mat& gray);
};

/// Loads the library once. @throws std::runtime_error if it cannot be loaded.
const Media& media();

/// Decodes a PNG of any colour type and depth to gray of 8 bits: of 16 bits the upper 8, colours
/// weighted as in JPEG, without transparency. A picture that is damaged or truncated is refused as
/// a whole. The size that the header claims is what is allocated, so check it first.
///
/// @param gray  (CV_8UC1) the picture; its memory is reused if the size fits; empty on failure.
/// @return what is wrong with the data; empty on success.
std::optional<std::string> decodePng(const std::uint8_t* data, std::size_t size, cv::Mat& gray);

/// Checks a picture's size [px] before it is decoded. @return the fault, if there is one.
std::optional<std::string> sizeFault(const cv::Size& size, const std::optional<cv::Size>& expected);

}  // namespace helix_arm::vision

/// Of the library.
extern "C" const helix_arm::vision::Media helix_arm_media;
