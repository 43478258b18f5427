#include <algorithm>
#include <array>
#include <csetjmp>
#include <cstdio>
#include <new>

#include <png.h>

#include "media.hpp"

namespace helix_arm::vision {
namespace {

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

std::optional<std::string> decodePng(const std::uint8_t* data, std::size_t size, cv::Mat& gray) {
  Reading reading{data, size, {}};
  if (Reader(reading).read(gray)) return std::nullopt;
  gray.release();
  return std::string("a damaged or truncated PNG: ") + reading.fault.data();
}

}  // namespace helix_arm::vision
