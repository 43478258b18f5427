#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include <opencv2/core.hpp>

namespace helix_arm::vision {

/// Decodes JPEG and MJPEG frames directly to gray; colours are not computed. No state is kept
/// between pictures.
class JpegDecoder {
 public:
  /// Maximum number of pixels. A header that claims more is refused before anything is allocated.
  static constexpr int kMaxPixels = 64'000'000;

  /// The size [px] that the header claims; empty if the header is invalid.
  static cv::Size claimedSize(const std::uint8_t* data, std::size_t size);

  /// Accepts gray and YCbCr, baseline and progressive, with or without Huffman tables (MJPEG omits
  /// the standard ones), with any padding after the last pixel. Everything else that violates the
  /// standard is refused, and so are truncated pictures: their pixels would be guessed.
  ///
  /// @param gray  (CV_8UC1) the picture; its memory is reused if the size fits; empty on failure.
  /// @return what is wrong with the data; empty on success.
  std::optional<std::string> decode(const std::uint8_t* data, std::size_t size, cv::Mat& gray);
};

/// Encodes gray pictures.
class JpegEncoder {
 public:
  /// @param quality  1 to 100.
  explicit JpegEncoder(int quality) : quality_(quality) {}

  /// @param gray  (CV_8UC1), not empty.
  /// @throws std::runtime_error on one that is too large.
  std::vector<std::uint8_t> encode(const cv::Mat& gray) const;

 private:
  int quality_;
};

}  // namespace helix_arm::vision
