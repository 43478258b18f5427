#pragma once

#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include <opencv2/core.hpp>

#include "helix_arm/vision/frame_source.hpp"

namespace helix_arm::vision {

/// Checks a picture's size [px] before it is decoded. @return the fault; nothing if the size is
/// acceptable.
std::optional<std::string> sizeFault(const cv::Size& size, const std::optional<cv::Size>& expected);

/// Independent pictures from files; see FrameSource::files().
std::unique_ptr<FrameSource> pictureFiles(std::vector<std::filesystem::path> paths,
                                          std::optional<cv::Size> expected);

}  // namespace helix_arm::vision
