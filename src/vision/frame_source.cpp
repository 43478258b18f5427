#include "helix_arm/vision/frame_source.hpp"

#include <algorithm>
#include <array>
#include <cctype>
#include <chrono>
#include <cmath>
#include <cstring>
#include <filesystem>
#include <limits>
#include <sstream>
#include <stdexcept>
#include <vector>

#include <opencv2/imgproc.hpp>
#include <opencv2/videoio.hpp>
#include <unistd.h>

#include "helix_arm/vision/jpeg.hpp"
#include "picture_files.hpp"

namespace helix_arm::vision {
namespace {

namespace fs = std::filesystem;

template <class... Parts>
std::string text(const Parts&... parts) {
  std::ostringstream out;
  (out << ... << parts);
  return out.str();
}

// ---- Webcams ------------------------------------------------------------------------------------

// Formats that hold a gray picture without conversion.
constexpr std::array<const char*, 4> kFormats = {"MJPG", "YUYV", "UYVY", "GREY"};

int codeOf(const std::string& fourcc) {
  return cv::VideoWriter::fourcc(fourcc[0], fourcc[1], fourcc[2], fourcc[3]);
}

std::string fourccOf(int code) {
  std::string name(4, ' ');
  std::memcpy(name.data(), &code, name.size());
  return name;
}

double steadySeconds() {
  return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count();
}

class V4l2Device : public VideoDevice {
 public:
  explicit V4l2Device(WebcamConfig config) : config_(std::move(config)) {}

  std::optional<std::string> open() override {
    // OpenCV only reports that opening failed, on stderr.
    if (access(config_.device.c_str(), F_OK) != 0) {
      return "the device does not exist; plug the camera in, or give another device";
    }
    if (access(config_.device.c_str(), R_OK | W_OK) != 0) {
      return "this user may not use the device; add the user to the group video";
    }
    if (!capture_.open(config_.device, cv::CAP_V4L2)) {
      return "it does not open as a camera; close other programs that use it";
    }
    capture_.set(cv::CAP_PROP_FOURCC, codeOf(config_.fourcc));
    capture_.set(cv::CAP_PROP_FRAME_WIDTH, config_.width);
    capture_.set(cv::CAP_PROP_FRAME_HEIGHT, config_.height);
    capture_.set(cv::CAP_PROP_FPS, config_.fps);
    capture_.set(cv::CAP_PROP_CONVERT_RGB, 0);
    const std::string fourcc = fourccOf(static_cast<int>(capture_.get(cv::CAP_PROP_FOURCC)));
    const double width = capture_.get(cv::CAP_PROP_FRAME_WIDTH);
    const double height = capture_.get(cv::CAP_PROP_FRAME_HEIGHT);
    if (fourcc != config_.fourcc || width != config_.width || height != config_.height) {
      return text("it gives ", width, " x ", height, " ", fourcc, " instead of ", config_.width,
                  " x ", config_.height, " ", config_.fourcc,
                  "; choose one of the formats that it supports");
    }
    constexpr double kManualExposure = 1;  // V4L2_EXPOSURE_MANUAL
    std::optional<std::string> fault =
        lock("focus", cv::CAP_PROP_AUTOFOCUS, 0, cv::CAP_PROP_FOCUS, config_.focus);
    if (!fault) {
      fault = lock("exposure", cv::CAP_PROP_AUTO_EXPOSURE, kManualExposure, cv::CAP_PROP_EXPOSURE,
                   config_.exposure);
    }
    return fault;
  }

  Read read(cv::Mat& gray, std::string& fault) override {
    if (!capture_.grab() || !capture_.retrieve(raw_) || raw_.empty()) {
      fault = "it delivers no more pictures; plug it in again";
      return Read::kGone;
    }
    if (config_.fourcc == "MJPG") {
      const std::size_t size = raw_.total() * raw_.elemSize();
      if (const auto wrong = wrongSize(JpegDecoder::claimedSize(raw_.data, size))) {
        fault = *wrong;
        return Read::kBroken;
      }
      if (const auto broken = decoder_.decode(raw_.data, size, gray)) {
        fault = *broken + "; if this goes on, try another cable or port";
        return Read::kBroken;
      }
    } else if (config_.fourcc == "GREY") {
      raw_.copyTo(gray);
    } else {
      cv::extractChannel(raw_, gray, config_.fourcc == "YUYV" ? 0 : 1);
    }
    const auto wrong = wrongSize(gray.size());
    fault = wrong.value_or("");
    return wrong ? Read::kBroken : Read::kPicture;
  }

  void close() override { capture_.release(); }

 private:
  // Without a valid header nothing is refused here; decoding reports it better.
  std::optional<std::string> wrongSize(const cv::Size& size) const {
    if (size.empty() || size == cv::Size(config_.width, config_.height)) return std::nullopt;
    return text("a picture of ", size.width, " x ", size.height, " px; expected ", config_.width,
                " x ", config_.height);
  }

  // OpenCV reads -1 for a control that the camera does not have, which then cannot drift.
  std::optional<std::string> lock(const char* name, int mode, double manual, int control,
                                  int value) {
    capture_.set(mode, manual);
    const double accepted = capture_.get(mode);
    if (accepted >= 0 && accepted != manual) {
      return text("its automatic ", name, " does not switch off; use a camera where it does");
    }
    if (capture_.get(control) >= 0 && !capture_.set(control, value)) {
      return text("its ", name, " cannot be ", value,
                  "; choose a value from what v4l2-ctl --list-ctrls says");
    }
    return std::nullopt;
  }

  WebcamConfig config_;
  cv::VideoCapture capture_;
  cv::Mat raw_;
  JpegDecoder decoder_;
};

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
    switch (device_->read(frame.gray, fault)) {
      case VideoDevice::Read::kPicture:
        return FrameStatus::kFrame;
      case VideoDevice::Read::kBroken:
        return fail(frame, name_ + ": " + fault);
      case VideoDevice::Read::kGone:
        break;
    }
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

// ---- Files --------------------------------------------------------------------------------------

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

template <std::size_t kSize>
std::string listOf(const std::array<const char*, kSize>& extensions) {
  std::string list;
  for (const char* extension : extensions)
    list += (list.empty() ? "" : " ") + std::string(extension);
  return list;
}

class VideoFile : public FrameSource {
 public:
  VideoFile(std::string path, std::optional<cv::Size> expected)
      : path_(std::move(path)), expected_(expected) {}

  FrameStatus next(Frame& frame) override {
    if (through_) return FrameStatus::kEnd;
    begin(frame, path_ + "#" + std::to_string(number_));
    if (!capture_.isOpened() && !open()) {
      through_ = true;
      return fail(frame, path_ + ": it is damaged or not a video");
    }
    if (const auto fault = sizeFault(size_, expected_)) {
      through_ = true;
      if (expected_ && size_ != *expected_) frame.wrong_size = size_;
      return fail(frame, path_ + ": " + *fault);
    }
    if (!capture_.read(raw_) || raw_.empty()) {
      through_ = true;
      if (frame.number > 0) return FrameStatus::kEnd;
      return fail(frame, path_ + ": the video holds no pictures");
    }
    if (!packets_) {
      if (raw_.size() != size_) return failSize(frame, raw_.size());
      cv::cvtColor(raw_, frame.gray, cv::COLOR_BGR2GRAY);
      return FrameStatus::kFrame;
    }
    const std::size_t bytes = raw_.total() * raw_.elemSize();
    const cv::Size claimed = JpegDecoder::claimedSize(raw_.data, bytes);
    if (!claimed.empty() && claimed != size_) return failSize(frame, claimed);
    if (const auto fault = decoder_.decode(raw_.data, bytes, frame.gray)) {
      return fail(frame, frame.name + ": " + *fault);
    }
    return FrameStatus::kFrame;
  }

  bool continuous() const override { return true; }

 private:
  FrameStatus failSize(Frame& frame, const cv::Size& size) const {
    return fail(frame, text(frame.name, ": a picture of ", size.width, " x ", size.height,
                            " px in a video of ", size_.width, " x ", size_.height));
  }

  bool open() {
    if (!capture_.open(path_, cv::CAP_FFMPEG)) return false;
    const std::string fourcc = fourccOf(static_cast<int>(capture_.get(cv::CAP_PROP_FOURCC)));
    size_ = cv::Size(static_cast<int>(capture_.get(cv::CAP_PROP_FRAME_WIDTH)),
                     static_cast<int>(capture_.get(cv::CAP_PROP_FRAME_HEIGHT)));
    packets_ = (fourcc == "MJPG" || fourcc == "mjpe") && capture_.set(cv::CAP_PROP_FORMAT, -1);
    return true;
  }

  std::string path_;
  std::optional<cv::Size> expected_;
  cv::Size size_;  // as stated by the video
  cv::VideoCapture capture_;
  bool packets_ = false;  // what is read are JPEGs
  bool through_ = false;
  cv::Mat raw_;
  JpegDecoder decoder_;
};

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

}  // namespace

void WebcamConfig::validate() const {
  const auto require = [](bool holds, const auto&... parts) {
    if (!holds) throw std::invalid_argument(text("webcam ", parts...));
  };
  require(!device.empty(), "device is empty; expected a path such as /dev/video0");
  require(width > 0 && height > 0, "size is ", width, " x ", height, "; expected > 0 px");
  require(std::find(kFormats.begin(), kFormats.end(), fourcc) != kFormats.end(), "fourcc is \"",
          fourcc, "\"; expected one of ", listOf(kFormats));
  require(fps > 0 && std::isfinite(fps), "fps is ", fps, "; expected a finite value > 0");
  require(focus >= 0, "focus is ", focus, "; expected >= 0");
  require(exposure >= 0, "exposure is ", exposure, "; expected >= 0");
  require(reconnect_after >= 0 && std::isfinite(reconnect_after), "reconnect_after is ",
          reconnect_after, "; expected a finite value >= 0 s");
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
  config.validate();
  return camera(std::make_unique<V4l2Device>(config), config.device, config.reconnect_after,
                steadySeconds);
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
    if (pictures.empty()) {
      throw std::invalid_argument(path + " holds no pictures; expected files ending in " +
                                  listOf(kPictures));
    }
    return pictureFiles(std::move(pictures), expected);
  }
  if (!fs::is_regular_file(path, error)) {
    throw std::invalid_argument(path + " is neither a file nor a folder" +
                                (error ? ": " + error.message() : ""));
  }
  if (hasExtension(path, kPictures)) {
    return pictureFiles({path}, expected);
  }
  if (hasExtension(path, kVideos)) return std::make_unique<VideoFile>(path, expected);
  throw std::invalid_argument(path + " is neither a picture (" + listOf(kPictures) +
                              ") nor a video (" + listOf(kVideos) + ")");
}

}  // namespace helix_arm::vision
