#pragma once

#include <memory>
#include <optional>
#include <string>

#include <opencv2/core.hpp>

#include "frame_source.hpp"

namespace helix_arm::vision {

/// Input by OpenCV's videoio and imgcodecs: webcams, videos, and pictures other than JPEG. They
/// bring 200 shared libraries, so that they are in a library that the first use loads.
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

/// Checks a picture's size [px] for its frame. @return the fault, if there is one.
std::optional<std::string> sizeFault(Frame& frame, const cv::Size& size,
                                     const std::optional<cv::Size>& expected);

}  // namespace helix_arm::vision

/// Entry of the library.
extern "C" const helix_arm::vision::Media helix_arm_media;
