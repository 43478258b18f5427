#include "vision/jpeg.hpp"

#include <algorithm>

#include <gtest/gtest.h>

#include "jpeg_pictures.hpp"

namespace helix_arm::test {
namespace {

using vision::JpegDecoder;

// The same without its segments of this code.
Bytes without(Bytes bytes, std::uint8_t code) {
  for (std::size_t i = 2; bytes[i + 1] != 0xda;) {
    const std::size_t size = 2 + 256 * bytes[i + 2] + bytes[i + 3];
    if (bytes[i + 1] == code) {
      bytes.erase(bytes.begin() + static_cast<long>(i),
                  bytes.begin() + static_cast<long>(i + size));
    } else {
      i += size;
    }
  }
  return bytes;
}

// JPEG's own definition of luma.
TEST(Jpeg, ColoursAreReadAsTheirLuma) {
  const cv::Mat colour = colourPicture(160, 120);
  for (const int subsampling : {TJSAMP_444, TJSAMP_422, TJSAMP_420, TJSAMP_440, TJSAMP_411}) {
    for (const int flags : {0, TJFLAG_PROGRESSIVE}) {
      const Bytes bytes = jpegOf(colour, TJPF_BGR, subsampling, 98, flags);
      cv::Mat gray;
      ASSERT_FALSE(JpegDecoder().decode(bytes.data(), bytes.size(), gray));
      ASSERT_EQ(gray.size(), colour.size());
      double worst = 0;
      for (int y = 0; y < gray.rows; ++y) {
        for (int x = 0; x < gray.cols; ++x) {
          const cv::Vec3b p = colour.at<cv::Vec3b>(y, x);
          const double luma = 0.114 * p[0] + 0.587 * p[1] + 0.299 * p[2];
          worst = std::max(worst, std::abs(luma - gray.at<std::uint8_t>(y, x)));
        }
      }
      EXPECT_LE(worst, 4) << "subsampling " << subsampling << " flags " << flags;
    }
  }
}

// MJPEG leaves out the Huffman tables of the standard's annex K.
TEST(Jpeg, FramesWithoutHuffmanTablesUseTheUsualOnes) {
  const Bytes bytes = jpegOf(colourPicture(64, 48), TJPF_BGR, TJSAMP_422);
  const Bytes bare = without(bytes, 0xc4);
  ASSERT_LT(bare.size() + 400, bytes.size());
  cv::Mat gray, gray_bare;
  ASSERT_FALSE(JpegDecoder().decode(bytes.data(), bytes.size(), gray));
  ASSERT_FALSE(JpegDecoder().decode(bare.data(), bare.size(), gray_bare));
  EXPECT_EQ(cv::norm(gray, gray_bare, cv::NORM_INF), 0);
}

}  // namespace
}  // namespace helix_arm::test
