#include "vision/jpeg.hpp"

#include <algorithm>

#include <gtest/gtest.h>

#include "jpeg_pictures.hpp"
#include "support/has.hpp"

namespace helix_arm::test {
namespace {

using vision::JpegDecoder;
using vision::JpegEncoder;

std::string faultOf(const Bytes& bytes) {
  cv::Mat gray(3, 3, CV_8UC1, cv::Scalar(7));
  const auto fault = JpegDecoder().decode(bytes.data(), bytes.size(), gray);
  EXPECT_EQ(gray.empty(), fault.has_value()) << "a refused picture leaves nothing behind";
  return fault.value_or("");
}

// Offset of the first marker of this code.
std::size_t markerAt(const Bytes& bytes, std::uint8_t code) {
  for (std::size_t i = 0; i + 1 < bytes.size(); ++i) {
    if (bytes[i] == 0xff && bytes[i + 1] == code) return i;
  }
  throw std::runtime_error("no such marker");
}

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

TEST(Jpeg, TruncatedPictureIsRefused) {
  const cv::Mat colour = colourPicture(40, 32);
  for (const int subsampling : {TJSAMP_GRAY, TJSAMP_420}) {
    for (const int flags : {0, TJFLAG_PROGRESSIVE}) {
      const Bytes bytes = jpegOf(colour, TJPF_BGR, subsampling, 90, flags);
      ASSERT_EQ(faultOf(bytes), "");
      for (std::size_t size = 0; size < bytes.size(); ++size) {
        EXPECT_NE(faultOf(Bytes(bytes.begin(), bytes.begin() + static_cast<long>(size))), "")
            << size << " of " << bytes.size() << " bytes";
      }
    }
  }
}

TEST(Jpeg, AFileThatIsNotAJpegIsRefusedWithItsReason) {
  cv::Mat gray;
  EXPECT_EQ(JpegDecoder().decode(nullptr, 0, gray), "no data; expected a JPEG");
  EXPECT_TRUE(has(faultOf(Bytes(1000, 0)), "not a valid JPEG header"));
  EXPECT_TRUE(has(faultOf({0xff, 0xd8, 0xff, 0xd9}), "claims 0 x 0 px"));
  const cv::Mat cmyk(48, 64, CV_8UC4, cv::Scalar(1, 2, 3, 4));
  EXPECT_TRUE(has(faultOf(jpegOf(cmyk, TJPF_CMYK, TJSAMP_444)), "CMYK"));
}

TEST(Jpeg, TheClaimedSizeIsKnownByTheHeaderAlone) {
  const Bytes bytes = JpegEncoder(90).encode(grayPicture(640, 480));
  EXPECT_EQ(JpegDecoder::claimedSize(bytes.data(), bytes.size()), cv::Size(640, 480));
  const std::size_t scan = markerAt(bytes, 0xda);
  EXPECT_EQ(JpegDecoder::claimedSize(bytes.data(), scan + 2 + 8), cv::Size(640, 480));
  EXPECT_TRUE(JpegDecoder::claimedSize(bytes.data(), 10).empty());
  EXPECT_TRUE(JpegDecoder::claimedSize(nullptr, 0).empty());
}

TEST(Jpeg, PaddingOfWebcamsIsAccepted) {
  const Bytes bytes = jpegOf(colourPicture(64, 48), TJPF_BGR, TJSAMP_422);
  Bytes after = bytes;
  after.insert(after.end(), 777, 0);
  EXPECT_EQ(faultOf(after), "");
  Bytes before = bytes;
  before.insert(before.end() - 2, 5, 0);
  EXPECT_EQ(faultOf(before), "");
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
