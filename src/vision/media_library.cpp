#include <cstring>
#include <utility>

#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>
#include <opencv2/videoio.hpp>
#include <unistd.h>

#include "helix_arm/basics/requirement.hpp"
#include "jpeg.hpp"
#include "media.hpp"

namespace helix_arm::vision {
namespace {

using basics::messageOf;

std::string fourccOf(int code) {
  std::string name(4, ' ');
  std::memcpy(name.data(), &code, name.size());
  return name;
}

std::optional<std::string> decoded(const cv::Mat& jpeg, cv::Mat& gray) {
  return JpegDecoder().decode(jpeg.data, jpeg.total() * jpeg.elemSize(), gray);
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
    const std::string& code = config_.fourcc;
    capture_.set(cv::CAP_PROP_FOURCC, cv::VideoWriter::fourcc(code[0], code[1], code[2], code[3]));
    capture_.set(cv::CAP_PROP_FRAME_WIDTH, config_.width);
    capture_.set(cv::CAP_PROP_FRAME_HEIGHT, config_.height);
    capture_.set(cv::CAP_PROP_FPS, config_.fps);
    capture_.set(cv::CAP_PROP_CONVERT_RGB, 0);
    const std::string fourcc = fourccOf(static_cast<int>(capture_.get(cv::CAP_PROP_FOURCC)));
    const double width = capture_.get(cv::CAP_PROP_FRAME_WIDTH);
    const double height = capture_.get(cv::CAP_PROP_FRAME_HEIGHT);
    if (fourcc != config_.fourcc || width != config_.width || height != config_.height) {
      return messageOf("it gives ", width, " x ", height, " ", fourcc, " instead of ",
                       config_.width, " x ", config_.height, " ", config_.fourcc,
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
      if (const auto broken = decoded(raw_, gray)) {
        fault = *broken + "; if this goes on, try another cable or port";
        return Read::kBroken;
      }
    } else if (config_.fourcc == "GREY") {
      raw_.copyTo(gray);
    } else {
      cv::extractChannel(raw_, gray, config_.fourcc == "YUYV" ? 0 : 1);
    }
    if (gray.size() == cv::Size(config_.width, config_.height)) return Read::kPicture;
    fault = messageOf("a picture of ", gray.cols, " x ", gray.rows, " px; expected ", config_.width,
                      " x ", config_.height);
    return Read::kBroken;
  }

  void close() override { capture_.release(); }

 private:
  // OpenCV reads -1 for a control that the camera does not have, which then cannot drift.
  std::optional<std::string> lock(const char* name, int mode, double manual, int control,
                                  int value) {
    capture_.set(mode, manual);
    const double accepted = capture_.get(mode);
    if (accepted >= 0 && accepted != manual) {
      return messageOf("its automatic ", name, " does not switch off; use a camera where it does");
    }
    if (capture_.get(control) >= 0 && !capture_.set(control, value)) {
      return messageOf("its ", name, " cannot be ", value,
                       "; choose a value from what v4l2-ctl --list-ctrls says");
    }
    return std::nullopt;
  }

  WebcamConfig config_;
  cv::VideoCapture capture_;
  cv::Mat raw_;
};

class VideoFile : public FrameSource {
 public:
  VideoFile(std::string path, std::optional<cv::Size> expected)
      : path_(std::move(path)), expected_(expected) {}

  FrameStatus next(Frame& frame) override {
    if (through_) return FrameStatus::kEnd;
    begin(frame, path_ + "#" + std::to_string(number_));
    through_ = true;  // unless a picture comes
    if (!capture_.isOpened() && !open())
      return fail(frame, path_ + ": it is damaged or not a video");
    if (const auto fault = sizeFault(frame, size_, expected_)) {
      return fail(frame, path_ + ": " + *fault);
    }
    if (!capture_.read(raw_) || raw_.empty()) {
      if (frame.number > 0) return FrameStatus::kEnd;
      return fail(frame, path_ + ": the video holds no pictures");
    }
    through_ = false;
    if (!packets_) {
      if (raw_.size() != size_) return failSize(frame, raw_.size());
      cv::cvtColor(raw_, frame.gray, cv::COLOR_BGR2GRAY);
      return FrameStatus::kFrame;
    }
    if (const auto fault = decoded(raw_, frame.gray)) {
      return fail(frame, frame.name + ": " + *fault);
    }
    return frame.gray.size() == size_ ? FrameStatus::kFrame : failSize(frame, frame.gray.size());
  }

  bool continuous() const override { return true; }

 private:
  FrameStatus failSize(Frame& frame, const cv::Size& size) const {
    return fail(frame, messageOf(frame.name, ": a picture of ", size.width, " x ", size.height,
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
};

std::optional<std::string> decode(const std::string& bytes, cv::Mat& gray) {
  // Not written to; cv::Mat has no constructor for constant data.
  const cv::Mat data(1, static_cast<int>(bytes.size()), CV_8UC1, const_cast<char*>(bytes.data()));
  try {
    // In the sensor's orientation: the calibration does not know the one stored in the file.
    // By way of colours: with a gamma in the file, libpng would weigh them otherwise than a JPEG
    // does.
    const cv::Mat colour = cv::imdecode(data, cv::IMREAD_COLOR | cv::IMREAD_IGNORE_ORIENTATION);
    if (colour.empty()) return "it is damaged, truncated or not a picture";
    cv::cvtColor(colour, gray, cv::COLOR_BGR2GRAY);
  } catch (const cv::Exception& error) {
    return "it does not decode: " + error.err;
  }
  return std::nullopt;
}

}  // namespace
}  // namespace helix_arm::vision

const helix_arm::vision::Media helix_arm_media = {
    [](const auto& config) -> std::unique_ptr<helix_arm::vision::VideoDevice> {
      return std::make_unique<helix_arm::vision::V4l2Device>(config);
    },
    [](const auto& path, const auto& expected) -> std::unique_ptr<helix_arm::vision::FrameSource> {
      return std::make_unique<helix_arm::vision::VideoFile>(path, expected);
    },
    helix_arm::vision::decode};
