#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include <opencv2/core.hpp>

namespace helix_arm::vision {

/// Decodes JPEG and MJPEG frames straight to gray; the colours are never computed. Nothing of one
/// picture enters the next.
class JpegDecoder {
 public:
  /// Most pixels a picture may have; a header that claims more, or more than its bytes can hold, is
  /// refused before anything is allocated.
  static constexpr int kMaxPixels = 64'000'000;
  /// Most scans of a progressive picture: each goes through all of its pixels. Encoders make 10.
  static constexpr int kMaxScans = 32;

  /// The size [px] that the header claims, by the header alone; empty where there is no sound one.
  static cv::Size claimedSize(const std::uint8_t* data, std::size_t size);

  /// Takes gray and YCbCr, baseline and progressive, with or without Huffman tables (MJPEG leaves
  /// out the usual ones), with any padding after the last pixel. All else that breaks the standard
  /// is refused, as truncated pictures are: pixels would be guessed.
  ///
  /// @param gray  (CV_8UC1) the picture, in the same memory as before where it fits; empty where
  /// this fails.
  /// @return nothing when it succeeded, else what is wrong with the data.
  std::optional<std::string> decode(const std::uint8_t* data, std::size_t size, cv::Mat& gray);
};

/// Encodes gray pictures.
class JpegEncoder {
 public:
  /// @param quality  1 to 100.
  /// @throws std::invalid_argument on another.
  explicit JpegEncoder(int quality);
  ~JpegEncoder();
  JpegEncoder(JpegEncoder&&) noexcept;
  JpegEncoder& operator=(JpegEncoder&&) noexcept;

  /// @param gray  (CV_8UC1), not empty.
  /// @throws std::invalid_argument on another picture, std::runtime_error on one that is too large.
  std::vector<std::uint8_t> encode(const cv::Mat& gray);

 private:
  struct Handle;
  std::unique_ptr<Handle> handle_;
  int quality_;
};

}  // namespace helix_arm::vision
