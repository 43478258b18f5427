#pragma once

#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "helix_arm/vision/frame_source.hpp"

namespace helix_arm::vision {

/// What a picture's size [px] alone says against it, to be known before it is decoded.
std::optional<std::string> sizeFault(const cv::Size& size, const std::optional<cv::Size>& expected);

/// Pictures of files, each by itself; see FrameSource::files().
std::unique_ptr<FrameSource> pictureFiles(std::vector<std::filesystem::path> paths,
                                          std::optional<cv::Size> expected);

}  // namespace helix_arm::vision
