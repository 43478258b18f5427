#include <algorithm>
#include <array>
#include <csetjmp>
#include <cstdio>
#include <new>
#include <stdexcept>

#include <png.h>
#include <turbojpeg.h>

#include "helix_arm/basics/requirement.hpp"
#include "helix_arm/vision/jpeg.hpp"
#include "media.hpp"

namespace helix_arm::vision {
namespace {

using basics::messageOf;
using Codec = std::unique_ptr<void, void (*)(void*)>;

Codec owned(tjhandle codec) {
  if (codec == nullptr) throw std::bad_alloc();
  return {codec, [](void* handle) { tjDestroy(handle); }};
}

// A block of 8 x 8 pixels takes at least one bit with Huffman codes.
constexpr long kMaxPixelsPerByte = 8 * 64;

// Padding after the last pixel, which many webcams send; everything was decoded before.
bool isHarmless(const std::string& warning) {
  return warning.find("extraneous bytes before marker 0xd9") != std::string::npos;
}

// Number of scans. Start-of-scan markers in skipped segments do not count: thumbnails have them.
int scansOf(const std::uint8_t* data, std::size_t size) {
  constexpr std::uint8_t kMark = 0xff, kFirstSegment = 0xc0, kScan = 0xda;
  int scans = 0;
  for (std::size_t i = 2; i + 1 < size;) {
    const std::uint8_t code = data[i + 1];
    if (data[i] != kMark || code == kMark) {
      ++i;
      continue;
    }
    i += 2;
    if (code == kScan) {
      ++scans;
    } else if (scans == 0 && code >= kFirstSegment && (code < 0xd0 || code > 0xd9) &&
               i + 1 < size) {
      i += std::max<std::size_t>(2, 256U * data[i] + data[i + 1]);
    }
  }
  return scans;
}

std::optional<std::string> decodeWith(tjhandle codec, const std::uint8_t* data, std::size_t size,
                                      cv::Mat& gray) {
  if (size == 0) return "no data; expected a JPEG";
  int width = 0, height = 0, subsampling = 0, colours = 0;
  if (tjDecompressHeader3(codec, data, size, &width, &height, &subsampling, &colours) != 0) {
    return std::string("not a valid JPEG header: ") + tjGetErrorStr2(codec);
  }
  if (colours == TJCS_CMYK || colours == TJCS_YCCK) {
    return "a JPEG in CMYK, which is not supported; expected gray or YCbCr";
  }
  const long pixels = static_cast<long>(width) * height;
  const std::string claim = messageOf("a JPEG header that claims ", width, " x ", height, " px");
  if (pixels <= 0 || pixels > JpegDecoder::kMaxPixels) {
    return messageOf(claim, "; expected 1 to ", JpegDecoder::kMaxPixels, " pixels");
  }
  if (pixels / kMaxPixelsPerByte > static_cast<long>(size)) {
    return messageOf(claim, ", which ", size, " bytes cannot hold");
  }
  const int scans = scansOf(data, size);
  if (scans > JpegDecoder::kMaxScans) {
    return messageOf("a JPEG of ", scans, " scans; expected at most ", JpegDecoder::kMaxScans);
  }
  gray.create(height, width, CV_8UC1);
  if (tjDecompress2(codec, data, size, gray.data, width, static_cast<int>(gray.step[0]), height,
                    TJPF_GRAY, TJFLAG_LIMITSCANS) != 0) {
    const std::string reason = tjGetErrorStr2(codec);
    const bool warned = tjGetErrorCode(codec) == TJERR_WARNING;
    if (!warned || !isHarmless(reason)) return "a damaged or truncated JPEG: " + reason;
  }
  return std::nullopt;
}

// What libpng's callbacks share. Plain data: libpng leaves them by longjmp, past every destructor.
struct Reading {
  const std::uint8_t* data;
  std::size_t left;
  std::array<char, 200> fault;
};

void takeBytes(png_structp png, png_bytep out, png_size_t count) {
  auto* const reading = static_cast<Reading*>(png_get_io_ptr(png));
  if (count > reading->left) png_error(png, "the data end early");
  std::copy_n(reading->data, count, out);
  reading->data += count;
  reading->left -= count;
}

void keepFault(png_structp png, png_const_charp message) {
  auto* const reading = static_cast<Reading*>(png_get_error_ptr(png));
  std::snprintf(reading->fault.data(), reading->fault.size(), "%s", message);
  png_longjmp(png, 1);
}

// Names of the chunks that say what the colours mean, each closed by a null.
constexpr png_byte kOfColours[] = "gAMA\0cHRM\0sRGB\0iCCP";
constexpr int kColourChunks = 4;

void ignoreWarning(png_structp, png_const_charp) {}  // of chunks that the pixels do not need

class Reader {
 public:
  explicit Reader(Reading& reading)
      : png_(png_create_read_struct(PNG_LIBPNG_VER_STRING, &reading, keepFault, ignoreWarning)),
        info_(png_ == nullptr ? nullptr : png_create_info_struct(png_)) {
    if (info_ == nullptr) {
      png_destroy_read_struct(&png_, nullptr, nullptr);
      throw std::bad_alloc();
    }
    png_set_read_fn(png_, &reading, takeBytes);
    // With them, libpng would weigh the colours in linear light, unlike those of a JPEG.
    png_set_keep_unknown_chunks(png_, PNG_HANDLE_CHUNK_NEVER, kOfColours, kColourChunks);
  }
  ~Reader() { png_destroy_read_struct(&png_, &info_, nullptr); }
  Reader(const Reader&) = delete;
  Reader& operator=(const Reader&) = delete;

  // No object with a destructor may live here: libpng comes back by longjmp. @return success.
  bool read(cv::Mat& gray) {
    if (setjmp(png_jmpbuf(png_)) != 0) return false;
    png_read_info(png_, info_);
    askForGray();
    const int passes = png_set_interlace_handling(png_);
    png_read_update_info(png_, info_);
    gray.create(static_cast<int>(png_get_image_height(png_, info_)),
                static_cast<int>(png_get_image_width(png_, info_)), CV_8UC1);
    for (int pass = 0; pass < passes; ++pass) {
      for (int row = 0; row < gray.rows; ++row) png_read_row(png_, gray.ptr(row), nullptr);
    }
    png_read_end(png_, nullptr);
    return true;
  }

 private:
  void askForGray() {
    constexpr double kRed = 0.299, kGreen = 0.587;  // of ITU-R BT.601, as in JPEG
    constexpr int kNoMessage = 1;
    const int colour = png_get_color_type(png_, info_);
    if (png_get_bit_depth(png_, info_) == 16) png_set_strip_16(png_);
    if (colour == PNG_COLOR_TYPE_PALETTE) png_set_palette_to_rgb(png_);
    if (colour == PNG_COLOR_TYPE_GRAY) png_set_expand_gray_1_2_4_to_8(png_);
    if ((colour & PNG_COLOR_MASK_COLOR) != 0) png_set_rgb_to_gray(png_, kNoMessage, kRed, kGreen);
    png_set_strip_alpha(png_);
  }

  png_structp png_;
  png_infop info_;
};

}  // namespace

std::optional<std::string> JpegDecoder::decode(const std::uint8_t* data, std::size_t size,
                                               cv::Mat& gray) {
  // One codec per picture: a codec would reuse the previous tables for a picture without tables.
  const Codec codec = owned(tjInitDecompress());
  std::optional<std::string> fault = decodeWith(codec.get(), data, size, gray);
  if (fault) gray.release();
  return fault;
}

cv::Size JpegDecoder::claimedSize(const std::uint8_t* data, std::size_t size) {
  const Codec codec = owned(tjInitDecompress());
  int width = 0, height = 0, subsampling = 0, colours = 0;
  if (size == 0 ||
      tjDecompressHeader3(codec.get(), data, size, &width, &height, &subsampling, &colours) != 0) {
    return {};
  }
  return {width, height};
}

JpegEncoder::JpegEncoder(int quality) : codec_(owned(tjInitCompress())), quality_(quality) {
  basics::require(quality >= 1 && quality <= 100, "JPEG quality is ", quality,
                  "; expected 1 to 100");
}

std::vector<std::uint8_t> JpegEncoder::encode(const cv::Mat& gray) {
  basics::require(!gray.empty() && gray.type() == CV_8UC1, "the picture to encode is ",
                  gray.empty() ? "empty" : "of type " + cv::typeToString(gray.type()),
                  "; expected gray of 8 bits, CV_8UC1");
  const tjhandle codec = codec_.get();
  const auto refuse = [&]() {
    throw std::runtime_error(messageOf("a picture of ", gray.cols, " x ", gray.rows,
                                       " px does not encode: ", tjGetErrorStr2(codec)));
  };
  const unsigned long worst = tjBufSize(gray.cols, gray.rows, TJSAMP_GRAY);
  if (worst == static_cast<unsigned long>(-1)) refuse();
  if (buffer_.size() < worst) buffer_.resize(worst);
  unsigned char* const begin = buffer_.data();
  unsigned char* place = begin;
  unsigned long size = worst;
  if (tjCompress2(codec, gray.data, gray.cols, static_cast<int>(gray.step[0]), gray.rows, TJPF_GRAY,
                  &place, &size, TJSAMP_GRAY, quality_, TJFLAG_NOREALLOC) != 0) {
    refuse();
  }
  return {begin, begin + size};
}

std::optional<std::string> decodePng(const std::uint8_t* data, std::size_t size, cv::Mat& gray) {
  Reading reading{data, size, {}};
  if (Reader(reading).read(gray)) return std::nullopt;
  gray.release();
  return std::string("a damaged or truncated PNG: ") + reading.fault.data();
}

}  // namespace helix_arm::vision
