#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include <opencv2/core.hpp>

namespace helix_arm::vision {

/// Decodes JPEG and MJPEG frames straight to gray; the colours are never computed.
class JpegDecoder {
 public:
  JpegDecoder();
  ~JpegDecoder();
  JpegDecoder(JpegDecoder&&) noexcept;
  JpegDecoder& operator=(JpegDecoder&&) noexcept;

  /// Most pixels a picture may have; a header that claims more is refused before anything is
  /// allocated.
  static constexpr int kMaxPixels = 64'000'000;

  /// @param gray  (CV_8UC1) written where this succeeds; its memory is used again where it fits.
  /// @return nothing when it succeeded, else what is wrong with the data. Truncated pictures are
  /// wrong.
  std::optional<std::string> decode(const std::uint8_t* data, std::size_t size, cv::Mat& gray);

 private:
  struct Handle;
  std::unique_ptr<Handle> handle_;
};

/// Encodes gray pictures.
class JpegEncoder {
 public:
  /// @param quality  1 to 100.
  explicit JpegEncoder(int quality);
  ~JpegEncoder();
  JpegEncoder(JpegEncoder&&) noexcept;
  JpegEncoder& operator=(JpegEncoder&&) noexcept;

  /// @param gray  (CV_8UC1), not empty.
  /// @throws std::runtime_error with the reason.
  std::vector<std::uint8_t> encode(const cv::Mat& gray);

 private:
  struct Handle;
  std::unique_ptr<Handle> handle_;
  int quality_;
};

}  // namespace helix_arm::vision
