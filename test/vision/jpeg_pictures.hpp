#pragma once

#include <cstdint>
#include <stdexcept>
#include <string>
#include <vector>

#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>
#include <turbojpeg.h>

namespace helix_arm::test {

using Bytes = std::vector<std::uint8_t>;

/// A smooth colour picture (CV_8UC3) with some noise in it.
inline cv::Mat colourPicture(int width, int height) {
  cv::Mat picture(height, width, CV_8UC3);
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) {
      const int grain = (x * 7919 + y * 104729) % 23;
      picture.at<cv::Vec3b>(y, x) = {cv::saturate_cast<std::uint8_t>(40 + 160 * x / width + grain),
                                     cv::saturate_cast<std::uint8_t>(200 - 150 * y / height),
                                     cv::saturate_cast<std::uint8_t>(90 + 60 * (x + y) / width)};
    }
  }
  return picture;
}

inline cv::Mat grayPicture(int width, int height, int shade = 0) {
  cv::Mat gray;
  cv::cvtColor(colourPicture(width, height), gray, cv::COLOR_BGR2GRAY);
  return gray + cv::Scalar(shade);
}

/// By OpenCV, as a file with this extension has it.
inline Bytes encoded(const std::string& extension, const cv::Mat& picture,
                     const std::vector<int>& options = {}) {
  Bytes bytes;
  cv::imencode(extension, picture, bytes, options);
  return bytes;
}

/// A JPEG by libjpeg-turbo itself.
/// @param pixels       of the format, e.g. TJPF_BGR.
/// @param subsampling  e.g. TJSAMP_420.
/// @param flags        e.g. TJFLAG_PROGRESSIVE.
inline Bytes jpegOf(const cv::Mat& pixels, int format, int subsampling, int quality = 90,
                    int flags = 0) {
  const tjhandle codec = tjInitCompress();
  unsigned char* buffer = nullptr;
  unsigned long size = 0;
  const int failed = tjCompress2(codec, pixels.data, pixels.cols, static_cast<int>(pixels.step[0]),
                                 pixels.rows, format, &buffer, &size, subsampling, quality, flags);
  const Bytes bytes(buffer, buffer + (failed == 0 ? size : 0));
  tjFree(buffer);
  tjDestroy(codec);
  if (failed != 0) throw std::runtime_error("libjpeg-turbo does not encode");
  return bytes;
}

}  // namespace helix_arm::test
