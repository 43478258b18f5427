#include <gtest/gtest.h>
#include <opencv2/imgcodecs.hpp>
#include <png.h>

#include "jpeg_pictures.hpp"
#include "vision/media.hpp"

namespace helix_arm::test {
namespace {

// A PNG by libpng itself, interlaced: of gray, or of as many colours of a palette; on request with
// the chunks that say that its colours are sRGB.
Bytes interlaced(const cv::Mat& pixels, int colours, bool says_srgb = false) {
  Bytes bytes;
  png_structp png = png_create_write_struct(PNG_LIBPNG_VER_STRING, nullptr, nullptr, nullptr);
  png_infop info = png_create_info_struct(png);
  const auto put = [](png_structp writer, png_bytep data, png_size_t size) {
    auto* const out = static_cast<Bytes*>(png_get_io_ptr(writer));
    out->insert(out->end(), data, data + size);
  };
  png_set_write_fn(png, &bytes, put, nullptr);
  png_set_IHDR(png, info, static_cast<png_uint_32>(pixels.cols),
               static_cast<png_uint_32>(pixels.rows), 8,
               colours > 0 ? PNG_COLOR_TYPE_PALETTE : PNG_COLOR_TYPE_GRAY, PNG_INTERLACE_ADAM7,
               PNG_COMPRESSION_TYPE_DEFAULT, PNG_FILTER_TYPE_DEFAULT);
  std::vector<png_color> palette;
  for (int i = 0; i < colours; ++i) {
    palette.push_back({static_cast<png_byte>(5 * i), static_cast<png_byte>(255 - 3 * i),
                       static_cast<png_byte>(7 * i % 256)});
  }
  if (colours > 0) png_set_PLTE(png, info, palette.data(), colours);
  if (says_srgb) png_set_sRGB_gAMA_and_cHRM(png, info, PNG_sRGB_INTENT_PERCEPTUAL);
  std::vector<png_bytep> rows;
  for (int y = 0; y < pixels.rows; ++y) rows.push_back(const_cast<png_bytep>(pixels.ptr(y)));
  png_set_rows(png, info, rows.data());
  png_write_png(png, info, PNG_TRANSFORM_IDENTITY, nullptr);
  png_destroy_write_struct(&png, &info);
  return bytes;
}

Bytes encoded(const cv::Mat& picture, const std::vector<int>& options = {}) {
  Bytes bytes;
  cv::imencode(".png", picture, bytes, options);
  return bytes;
}

std::vector<std::pair<const char*, Bytes>> soundPictures() {
  const cv::Mat colour = colourPicture(37, 29);
  cv::Mat gray(colour.size(), CV_8UC1), alpha(colour.size(), CV_8UC4), indices(29, 37, CV_8UC1);
  for (int y = 0; y < colour.rows; ++y) {
    for (int x = 0; x < colour.cols; ++x) {
      const cv::Vec3b c = colour.at<cv::Vec3b>(y, x);
      gray.at<std::uint8_t>(y, x) = c[1];
      alpha.at<cv::Vec4b>(y, x) = {c[0], c[1], c[2], static_cast<std::uint8_t>(7 * x)};
      indices.at<std::uint8_t>(y, x) = static_cast<std::uint8_t>((x + y) % 40);
    }
  }
  cv::Mat deep_gray, deep_colour;
  gray.convertTo(deep_gray, CV_16U, 255, 91);
  colour.convertTo(deep_colour, CV_16U, 256, 200);
  return {{"gray", encoded(gray)},
          {"colour", encoded(colour)},
          {"with alpha", encoded(alpha)},
          {"gray of 16 bits", encoded(deep_gray)},
          {"colour of 16 bits", encoded(deep_colour)},
          {"black and white", encoded(gray > 120, {cv::IMWRITE_PNG_BILEVEL, 1})},
          {"interlaced", interlaced(gray, 0)},
          {"interlaced palette", interlaced(indices, 40)}};
}

TEST(Png, EveryKindIsReadAsOpenCvReadsIt) {
  for (const auto& [kind, bytes] : soundPictures()) {
    cv::Mat gray;
    const auto fault = vision::decodePng(bytes.data(), bytes.size(), gray);
    ASSERT_FALSE(fault) << kind << ": " << *fault;
    ASSERT_EQ(gray.type(), CV_8UC1) << kind;
    const cv::Mat expected =
        cv::imdecode(bytes, cv::IMREAD_GRAYSCALE | cv::IMREAD_IGNORE_ORIENTATION);
    ASSERT_EQ(gray.size(), expected.size()) << kind;
    EXPECT_LE(cv::norm(gray, expected, cv::NORM_INF), 1) << kind;
    EXPECT_GT(cv::norm(gray, cv::NORM_INF), 100) << kind;
  }
}

TEST(Png, ColoursAreWeightedAsTheyAreWhateverThePictureSaysOfThem) {
  cv::Mat indices(29, 37, CV_8UC1), plain, said;
  for (int i = 0; i < indices.rows * indices.cols; ++i) {
    indices.data[i] = static_cast<std::uint8_t>(i % 40);
  }
  for (const auto& [says_srgb, gray] : {std::pair(false, &plain), std::pair(true, &said)}) {
    const Bytes bytes = interlaced(indices, 40, says_srgb);
    ASSERT_FALSE(vision::decodePng(bytes.data(), bytes.size(), *gray));
  }
  EXPECT_EQ(cv::norm(plain, said, cv::NORM_INF), 0);
}

TEST(Png, ATruncatedPictureIsRefusedWhereverItEnds) {
  for (const auto& [kind, bytes] : soundPictures()) {
    for (std::size_t size = 0; size < bytes.size(); size += size < 60 ? 1 : 97) {
      cv::Mat gray(3, 3, CV_8UC1);
      const auto fault = vision::decodePng(bytes.data(), size, gray);
      ASSERT_TRUE(fault) << kind << " of " << size << " bytes";
      EXPECT_EQ(fault->find("a damaged or truncated PNG: "), 0u) << *fault;
      EXPECT_TRUE(gray.empty());
    }
  }
}

}  // namespace
}  // namespace helix_arm::test
