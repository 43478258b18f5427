#include <algorithm>

#include <gtest/gtest.h>
#include <png.h>

#include "helix_arm/vision/jpeg.hpp"
#include "jpeg_pictures.hpp"
#include "support/has.hpp"
#include "vision/media.hpp"

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

TEST(Jpeg, GrayPicturesComeBack) {
  for (const cv::Size size :
       {cv::Size(1, 1), cv::Size(7, 3), cv::Size(64, 48), cv::Size(641, 479)}) {
    const cv::Mat picture = grayPicture(size.width, size.height);
    const Bytes bytes = JpegEncoder(95).encode(picture);
    cv::Mat gray;
    ASSERT_FALSE(JpegDecoder().decode(bytes.data(), bytes.size(), gray));
    ASSERT_EQ(gray.type(), CV_8UC1);
    ASSERT_EQ(gray.size(), size);
    EXPECT_LE(cv::norm(gray, picture, cv::NORM_L1) / static_cast<double>(picture.total()), 2.0);
  }
}

TEST(Jpeg, PartsOfPicturesAreEncodedAsTheyAre) {
  const cv::Mat whole = grayPicture(200, 100);
  const cv::Mat part = whole(cv::Rect(31, 17, 90, 60));
  JpegEncoder encoder(80);
  const Bytes bytes = encoder.encode(part);
  EXPECT_EQ(bytes, encoder.encode(part.clone()));
  EXPECT_EQ(bytes, JpegEncoder(80).encode(part)) << "nothing is left over from the last picture";
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

// What a driver makes of a frame that was cut off on its way.
TEST(Jpeg, TruncatedPictureWithAnEndPutToItIsRefused) {
  const Bytes bytes = jpegOf(colourPicture(160, 120), TJPF_BGR, TJSAMP_422);
  const std::size_t scan = markerAt(bytes, 0xda) + 14;
  for (std::size_t size = scan; size + 40 < bytes.size(); size += 97) {
    Bytes cut(bytes.begin(), bytes.begin() + static_cast<long>(size));
    cut.insert(cut.end(), {0xff, 0xd9});
    EXPECT_NE(faultOf(cut), "") << size << " of " << bytes.size() << " bytes";
    Bytes padded = bytes;
    std::fill(padded.begin() + static_cast<long>(size), padded.end(), 0);
    EXPECT_NE(faultOf(padded), "") << size << " of " << bytes.size() << " bytes, then zeros";
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

// A header may claim any size; memory is for what the data can hold.
TEST(Jpeg, ClaimedSizesThatCannotBeAreRefused) {
  const auto claim = [](Bytes bytes, int width, int height) {
    const std::size_t frame = markerAt(bytes, 0xc0);
    bytes[frame + 5] = static_cast<std::uint8_t>(height >> 8);
    bytes[frame + 6] = static_cast<std::uint8_t>(height & 255);
    bytes[frame + 7] = static_cast<std::uint8_t>(width >> 8);
    bytes[frame + 8] = static_cast<std::uint8_t>(width & 255);
    return bytes;
  };
  const Bytes bytes = JpegEncoder(90).encode(grayPicture(64, 48));
  ASSERT_EQ(faultOf(claim(bytes, 64, 48)), "");
  EXPECT_NE(faultOf(claim(bytes, 0, 48)), "");
  EXPECT_NE(faultOf(claim(bytes, 64, 0)), "");
  EXPECT_TRUE(has(faultOf(claim(bytes, 65000, 65000)), "claims 65000 x 65000 px; expected"));
  EXPECT_TRUE(has(faultOf(claim(bytes, 5000, 5000)), "claims 5000 x 5000 px, which"));
  EXPECT_NE(faultOf(claim(bytes, 64, 200)), "");
  // The flattest picture there is takes more than a bit a block, and passes.
  const cv::Mat flat(2000, 3000, CV_8UC1, cv::Scalar(90));
  EXPECT_EQ(faultOf(jpegOf(flat, TJPF_GRAY, TJSAMP_GRAY, 50)), "");
  EXPECT_EQ(faultOf(jpegOf(flat, TJPF_GRAY, TJSAMP_GRAY, 50, TJFLAG_PROGRESSIVE)), "");
}

TEST(Jpeg, TheClaimedSizeIsKnownByTheHeaderAlone) {
  const Bytes bytes = JpegEncoder(90).encode(grayPicture(640, 480));
  EXPECT_EQ(JpegDecoder::claimedSize(bytes.data(), bytes.size()), cv::Size(640, 480));
  const std::size_t scan = markerAt(bytes, 0xda);
  EXPECT_EQ(JpegDecoder::claimedSize(bytes.data(), scan + 2 + 8), cv::Size(640, 480));
  EXPECT_TRUE(JpegDecoder::claimedSize(bytes.data(), 10).empty());
  EXPECT_TRUE(JpegDecoder::claimedSize(nullptr, 0).empty());
}

// A picture whose last scan comes again and again: each is decoded over all of its pixels.
Bytes withScans(const Bytes& bytes, int count) {
  std::vector<std::size_t> scans;
  for (std::size_t i = 0; i + 1 < bytes.size(); ++i) {
    if (bytes[i] == 0xff && bytes[i + 1] == 0xda) scans.push_back(i);
  }
  const auto last = bytes.begin() + static_cast<long>(scans.back()), end = bytes.end() - 2;
  const Bytes scan(last, end);
  Bytes out(bytes.begin(), end);
  for (int i = static_cast<int>(scans.size()); i < count; ++i) {
    out.insert(out.end(), scan.begin(), scan.end());
  }
  out.insert(out.end(), {0xff, 0xd9});
  return out;
}

TEST(Jpeg, ScansAreCountedBeforeTheyAreDecoded) {
  const Bytes bytes = jpegOf(colourPicture(64, 48), TJPF_BGR, TJSAMP_420, 90, TJFLAG_PROGRESSIVE);
  ASSERT_EQ(faultOf(bytes), "");
  EXPECT_FALSE(has(faultOf(withScans(bytes, JpegDecoder::kMaxScans)), " scans; expected"));
  for (const int count : {JpegDecoder::kMaxScans + 1, 490}) {
    EXPECT_EQ(faultOf(withScans(bytes, count)), "a JPEG of " + std::to_string(count) +
                                                    " scans; expected at most " +
                                                    std::to_string(JpegDecoder::kMaxScans));
  }
}

// A camera puts a small picture of its own into a segment before the first scan.
TEST(Jpeg, ScansOfAPictureInsideThePictureDoNotCount) {
  Bytes bytes = JpegEncoder(90).encode(grayPicture(64, 48));
  Bytes segment = {0xff, 0xe1, 0x01, 0x02};
  for (int i = 0; i < 128; ++i) segment.insert(segment.end(), {0xff, 0xda});
  bytes.insert(bytes.begin() + 2, segment.begin(), segment.end());
  EXPECT_EQ(faultOf(bytes), "");
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

TEST(Jpeg, TablesOfTheLastPictureAreNotUsed) {
  const Bytes bytes = jpegOf(colourPicture(64, 48), TJPF_BGR, TJSAMP_422);
  const Bytes no_quantisation = without(bytes, 0xdb);
  JpegDecoder decoder;
  cv::Mat gray;
  ASSERT_FALSE(decoder.decode(bytes.data(), bytes.size(), gray));
  EXPECT_TRUE(decoder.decode(no_quantisation.data(), no_quantisation.size(), gray));
}

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
  return {{"gray", encoded(".png", gray)},
          {"colour", encoded(".png", colour)},
          {"with alpha", encoded(".png", alpha)},
          {"gray of 16 bits", encoded(".png", deep_gray)},
          {"colour of 16 bits", encoded(".png", deep_colour)},
          {"black and white", encoded(".png", gray > 120, {cv::IMWRITE_PNG_BILEVEL, 1})},
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
