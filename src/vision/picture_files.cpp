#include "picture_files.hpp"

#include <algorithm>
#include <cstdint>
#include <initializer_list>
#include <utility>
#include <variant>

#include "helix_arm/basics/regular_file.hpp"
#include "helix_arm/estimation/camera.hpp"
#include "helix_arm/vision/jpeg.hpp"
#include "media.hpp"
#include "picture_header.hpp"
#include "png.hpp"

namespace helix_arm::vision {
namespace {

constexpr std::size_t kMostBytes = 128U << 20U;  // of a file

std::string sizeText(const cv::Size& size) {
  return std::to_string(size.width) + " x " + std::to_string(size.height);
}

bool startsWith(const std::vector<std::uint8_t>& bytes, std::initializer_list<std::uint8_t> mark) {
  return bytes.size() >= mark.size() && std::equal(mark.begin(), mark.end(), bytes.begin());
}

// @return the fault; absent on success.
std::optional<std::string> decodePicture(const std::vector<std::uint8_t>& bytes, cv::Mat& gray) {
  if (startsWith(bytes, {0xff, 0xd8}))
    return JpegDecoder().decode(bytes.data(), bytes.size(), gray);
  if (startsWith(bytes, {0x89, 'P', 'N', 'G'})) return decodePng(bytes.data(), bytes.size(), gray);
  return media().decode(bytes, gray);
}

class PictureFiles : public FrameSource {
 public:
  PictureFiles(std::vector<std::filesystem::path> paths, std::optional<cv::Size> expected)
      : paths_(std::move(paths)), expected_(expected) {}

  FrameStatus next(Frame& frame) override {
    if (number_ == paths_.size()) return FrameStatus::kEnd;
    begin(frame, paths_[number_].string());
    if (const auto fault = read(frame)) return fail(frame, frame.name + ": " + *fault);
    return FrameStatus::kFrame;
  }

  bool continuous() const override { return false; }

 private:
  // @return the fault; absent on success.
  std::optional<std::string> read(Frame& frame) {
    basics::RegularFile file(frame.name);
    const std::optional<std::string> content = file.readAll(kMostBytes);
    if (!content) return "the file " + file.fault();
    bytes_.assign(content->begin(), content->end());
    const std::variant<cv::Size, std::string> claimed = claimedSize(bytes_);
    if (const auto* fault = std::get_if<std::string>(&claimed)) return *fault;
    const cv::Size size = std::get<cv::Size>(claimed);
    if (expected_ && size != *expected_) frame.wrong_size = size;
    if (const auto fault = sizeFault(size, expected_)) return fault;
    if (const auto fault = decodePicture(bytes_, frame.gray)) return fault;
    if (frame.gray.size() != size) return "it is not of the size that its header claims";
    return std::nullopt;
  }

  std::vector<std::filesystem::path> paths_;
  std::optional<cv::Size> expected_;
  std::vector<std::uint8_t> bytes_;
};

}  // namespace

std::optional<std::string> sizeFault(const cv::Size& size,
                                     const std::optional<cv::Size>& expected) {
  const std::string found = "the picture has " + sizeText(size) + " px; expected ";
  if (expected && size != *expected) return found + sizeText(*expected);
  if (std::max(size.width, size.height) > estimation::Camera::kMaxSide) {
    return found + "at most " + std::to_string(estimation::Camera::kMaxSide) +
           " px per side: make it smaller";
  }
  if (static_cast<std::int64_t>(size.width) * size.height > JpegDecoder::kMaxPixels) {
    return found + "at most " + std::to_string(JpegDecoder::kMaxPixels) +
           " pixels: make it smaller";
  }
  return std::nullopt;
}

std::unique_ptr<FrameSource> pictureFiles(std::vector<std::filesystem::path> paths,
                                          std::optional<cv::Size> expected) {
  return std::make_unique<PictureFiles>(std::move(paths), expected);
}

}  // namespace helix_arm::vision
