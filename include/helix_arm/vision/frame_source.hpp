#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <variant>

#include <opencv2/core.hpp>

namespace helix_arm::vision {

/// A webcam, by V4L2.
struct WebcamConfig {
  std::string device = "/dev/video0";
  int width = 1280, height = 720;  ///< [px]
  std::string fourcc = "MJPG";     ///< four characters
  double fps = 30.0;               ///< > 0 [Hz]
  /// Locked, so that the focal length stays as calibrated; in the driver's units.
  int focus = 0;
  int exposure = 157;            ///< locked; in the driver's units (often 100 us)
  double reconnect_after = 1.0;  ///< between tries to open it again, >= 0 [s]

  /// @throws std::invalid_argument naming the value and its rule.
  void validate() const;
};

/// What came of asking for the next frame.
enum class FrameStatus {
  kFrame,  ///< a picture
  kFault,  ///< none this time: Frame::fault says why; the next call tries again, or goes on
  kEnd,    ///< a file or folder is through
};

struct Frame {
  cv::Mat gray;              ///< (CV_8UC1); its memory is used again by the next call
  std::string name;          ///< file, or `file#number`, or the device
  std::string fault;         ///< culprit and remedy
  std::uint64_t number = 0;  ///< counted from 0, faults included
};

/// Gray pictures, one after the other, from a webcam, a video file, a picture or a folder of
/// pictures (in the order of their names).
class FrameSource {
 public:
  virtual ~FrameSource() = default;
  virtual FrameStatus next(Frame& frame) = 0;

  /// Unplugged cameras are opened again as soon as they are back.
  static std::unique_ptr<FrameSource> webcam(const WebcamConfig& config);
  /// @throws std::invalid_argument when there is no such file or folder, or nothing in it that
  /// could be a picture.
  static std::unique_ptr<FrameSource> files(const std::string& path);
};

}  // namespace helix_arm::vision
