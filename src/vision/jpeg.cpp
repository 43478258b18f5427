#include "jpeg.hpp"

#include <memory>
#include <new>
#include <stdexcept>

#include <turbojpeg.h>

#include "helix_arm/basics/requirement.hpp"

namespace helix_arm::vision {
namespace {

using basics::messageOf;
using Codec = std::unique_ptr<void, void (*)(void*)>;

Codec owned(tjhandle codec) {
  if (codec == nullptr) throw std::bad_alloc();
  return {codec, [](void* handle) { tjDestroy(handle); }};
}

// Padding after the last pixel, which many webcams send; everything was decoded before.
bool isHarmless(const std::string& warning) {
  return warning.find("extraneous bytes before marker 0xd9") != std::string::npos;
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
  if (pixels <= 0 || pixels > JpegDecoder::kMaxPixels) {
    return messageOf("a JPEG header that claims ", width, " x ", height, " px; expected 1 to ",
                     JpegDecoder::kMaxPixels, " pixels");
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

std::vector<std::uint8_t> JpegEncoder::encode(const cv::Mat& gray) const {
  const Codec codec = owned(tjInitCompress());
  unsigned char* encoded = nullptr;
  unsigned long size = 0;
  const int failed = tjCompress2(codec.get(), gray.data, gray.cols, static_cast<int>(gray.step[0]),
                                 gray.rows, TJPF_GRAY, &encoded, &size, TJSAMP_GRAY, quality_, 0);
  const std::unique_ptr<unsigned char, void (*)(unsigned char*)> bytes(encoded, tjFree);
  if (failed != 0) {
    throw std::runtime_error(messageOf("a picture of ", gray.cols, " x ", gray.rows,
                                       " px does not encode: ", tjGetErrorStr2(codec.get())));
  }
  return {encoded, encoded + size};
}

}  // namespace helix_arm::vision
