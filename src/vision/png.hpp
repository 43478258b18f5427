#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>

#include <opencv2/core.hpp>

namespace helix_arm::vision {

/// Decodes a PNG of any colour type and depth to gray of 8 bits: of 16 bits the upper 8, colours
/// weighted as in JPEG, without transparency. A picture that is damaged or truncated is refused as
/// a whole. The size that the header claims is what is allocated, so check it first.
///
/// @param gray  (CV_8UC1) the picture; its memory is reused if the size fits; empty on failure.
/// @return what is wrong with the data; empty on success.
std::optional<std::string> decodePng(const std::uint8_t* data, std::size_t size, cv::Mat& gray);

}  // namespace helix_arm::vision
