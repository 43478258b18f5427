#include "frame_source.hpp"

#include <algorithm>
#include <array>
#include <cctype>
#include <chrono>
#include <filesystem>
#include <limits>
#include <stdexcept>

#include <dlfcn.h>

#include "basics/regular_file.hpp"
#include "basics/text.hpp"
#include "helix_arm/basics/requirement.hpp"
#include "helix_arm/localization/camera.hpp"
#include "jpeg.hpp"
#include "media.hpp"

namespace helix_arm::vision {
namespace {

namespace fs = std::filesystem;

constexpr double kReconnectAfter = 1.0;  // [s]

class CameraSource : public FrameSource {
 public:
  CameraSource(std::unique_ptr<VideoDevice> device, std::string name, double reconnect_after,
               std::function<double()> now)
      : device_(std::move(device)),
        name_(std::move(name)),
        reconnect_after_(reconnect_after),
        now_(std::move(now)) {}

  FrameStatus next(Frame& frame) override {
    begin(frame, name_);
    if (!open_) {
      const double wait = next_try_ - now_();
      if (wait > 0) return fail(frame, fault_, wait);
      if (const auto fault = device_->open()) return lose(frame, *fault);
      open_ = true;
    }
    std::string fault;
    const VideoDevice::Read read = device_->read(frame.gray, fault);
    if (read == VideoDevice::Read::kPicture) return FrameStatus::kFrame;
    if (read == VideoDevice::Read::kBroken) return fail(frame, name_ + ": " + fault);
    return lose(frame, fault);
  }

  bool continuous() const override { return true; }

 private:
  FrameStatus lose(Frame& frame, const std::string& fault) {
    device_->close();
    open_ = false;
    next_try_ = now_() + reconnect_after_;
    fault_ = name_ + ": " + fault;
    return fail(frame, fault_, reconnect_after_);
  }

  std::unique_ptr<VideoDevice> device_;
  std::string name_;
  double reconnect_after_;
  std::function<double()> now_;
  bool open_ = false;
  double next_try_ = -std::numeric_limits<double>::infinity();
  std::string fault_;
};

constexpr std::size_t kMostBytes = 128U << 20U;  // of a file

std::string sizeText(const cv::Size& size) {
  return std::to_string(size.width) + " x " + std::to_string(size.height);
}

class PictureFiles : public FrameSource {
 public:
  PictureFiles(std::vector<fs::path> paths, std::optional<cv::Size> expected)
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
    if (content->empty()) return "the file is empty";
    const auto* const data = reinterpret_cast<const std::uint8_t*>(content->data());
    const bool is_jpeg = content->compare(0, 2, "\xff\xd8") == 0;
    if (const auto fault = is_jpeg ? JpegDecoder().decode(data, content->size(), frame.gray)
                                   : media().decode(*content, frame.gray)) {
      return fault;
    }
    return sizeFault(frame, frame.gray.size(), expected_);
  }

  std::vector<fs::path> paths_;
  std::optional<cv::Size> expected_;
};

constexpr char kLibrary[] = "libhelix_arm_media.so";

const Media& load() {
  void* library = dlopen(kLibrary, RTLD_NOW | RTLD_LOCAL);
  const void* symbol = library == nullptr ? nullptr : dlsym(library, "helix_arm_media");
  if (symbol == nullptr) {
    const char* fault = dlerror();
    throw std::runtime_error(
        std::string("videos, webcams and pictures other than JPEG need ") + kLibrary +
        ", which does not load: " + (fault == nullptr ? "it is empty" : fault) +
        "; build or install helix_arm again");
  }
  return *static_cast<const Media*>(symbol);
}

constexpr std::array<const char*, 10> kPictures = {".jpg", ".jpeg", ".png", ".bmp",  ".pgm",
                                                   ".ppm", ".pnm",  ".tif", ".tiff", ".webp"};
constexpr std::array<const char*, 8> kVideos = {".avi",  ".mp4", ".mkv", ".mov",
                                                ".webm", ".m4v", ".mpg", ".mjpeg"};

template <std::size_t kSize>
bool hasExtension(const fs::path& path, const std::array<const char*, kSize>& extensions) {
  std::string extension = path.extension().string();
  for (char& c : extension) c = static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
  return std::find(extensions.begin(), extensions.end(), extension) != extensions.end();
}

std::vector<fs::path> picturesIn(const fs::path& folder) {
  std::vector<fs::path> pictures;
  std::error_code error, ignored;
  for (fs::directory_iterator entry(folder, error), end; !error && entry != end;
       entry.increment(error)) {
    if (entry->is_regular_file(ignored) && hasExtension(entry->path(), kPictures)) {
      pictures.push_back(entry->path());
    }
  }
  if (error) throw std::invalid_argument(folder.string() + " cannot be read: " + error.message());
  std::sort(pictures.begin(), pictures.end());
  return pictures;
}

bool equal(const cv::Mat& a, const cv::Mat& b) {
  return !a.empty() && a.size() == b.size() && a.type() == b.type() &&
         cv::norm(a, b, cv::NORM_INF) == 0;
}

}  // namespace

const Media& media() {
  static const Media& loaded = load();
  return loaded;
}

std::optional<std::string> sizeFault(Frame& frame, const cv::Size& size,
                                     const std::optional<cv::Size>& expected) {
  const std::string found = "the picture has " + sizeText(size) + " px; expected ";
  if (expected && size != *expected) {
    frame.wrong_size = size;
    return found + sizeText(*expected);
  }
  if (std::max(size.width, size.height) > estimation::Camera::kMaxSide) {
    return found + "at most " + std::to_string(estimation::Camera::kMaxSide) +
           " px per side: make it smaller";
  }
  if (static_cast<std::int64_t>(size.width) * size.height > JpegDecoder::kMaxPixels) {
    return basics::messageOf(found, "at most ", JpegDecoder::kMaxPixels,
                             " pixels: make it smaller");
  }
  return std::nullopt;
}

void FrameSource::begin(Frame& frame, const std::string& name) {
  frame.name = name;
  frame.fault.clear();
  frame.wrong_size.reset();
  frame.retry_after = 0;
  frame.number = number_++;
}

FrameStatus FrameSource::fail(Frame& frame, const std::string& fault, double retry_after) {
  frame.gray.release();
  frame.fault = fault;
  frame.retry_after = retry_after;
  return FrameStatus::kFault;
}

std::unique_ptr<FrameSource> FrameSource::webcam(const WebcamConfig& config) {
  return camera(media().webcam(config), config.device, kReconnectAfter, [] {
    const auto now = std::chrono::steady_clock::now().time_since_epoch();
    return std::chrono::duration<double>(now).count();
  });
}

std::unique_ptr<FrameSource> FrameSource::camera(std::unique_ptr<VideoDevice> device,
                                                 const std::string& name, double reconnect_after,
                                                 std::function<double()> now) {
  return std::make_unique<CameraSource>(std::move(device), name, reconnect_after, std::move(now));
}

std::unique_ptr<FrameSource> FrameSource::files(const std::string& path,
                                                std::optional<cv::Size> expected) {
  std::error_code error;
  if (fs::is_directory(path, error)) {
    std::vector<fs::path> pictures = picturesIn(path);
    basics::require(!pictures.empty(), path, " holds no pictures; expected files ending in ",
                    basics::joined(kPictures, " "));
    return std::make_unique<PictureFiles>(std::move(pictures), expected);
  }
  const bool is_file = fs::is_regular_file(path, error);
  basics::require(is_file, path, " is neither a file nor a folder",
                  error ? ": " + error.message() : "");
  if (hasExtension(path, kPictures)) {
    return std::make_unique<PictureFiles>(std::vector<fs::path>{path}, expected);
  }
  if (hasExtension(path, kVideos)) return media().video(path, expected);
  throw std::invalid_argument(path + " is neither a picture (" + basics::joined(kPictures, " ") +
                              ") nor a video (" + basics::joined(kVideos, " ") + ")");
}

bool FrozenWatch::isFrozen(const cv::Mat& gray, const Eigen::Vector3d& model_tip) {
  if (equal(gray, before_)) return (model_tip - tip_).norm() > kMotion;
  gray.copyTo(before_);
  tip_ = model_tip;
  return false;
}

}  // namespace helix_arm::vision
