#pragma once

#include <cstdint>
#include <string>
#include <variant>
#include <vector>

#include <opencv2/core.hpp>

namespace helix_arm::vision {

/// The size [px] that a picture's header claims, read without decoding: JPEG, PNG, BMP, PNM, TIFF
/// and WebP. A decoder of these formats allocates a small multiple of it.
/// @return the size, both > 0; or what is wrong with the header.
std::variant<cv::Size, std::string> claimedSize(const std::vector<std::uint8_t>& bytes);

}  // namespace helix_arm::vision
