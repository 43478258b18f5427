#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <variant>

#include <opencv2/core.hpp>

namespace helix_arm::vision {

/// A webcam, by V4L2.
struct WebcamConfig {
  std::string device = "/dev/video0";
  int width = 1280, height = 720;  ///< [px]
  std::string fourcc = "MJPG";     ///< MJPG, YUYV, UYVY or GREY
  double fps = 30.0;               ///< > 0 [Hz]
  /// Locked, so that the focal length stays as calibrated; in the driver's units, >= 0.
  int focus = 0;
  int exposure = 157;            ///< locked; in the driver's units (often 100 us), >= 0
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
  cv::Mat gray;       ///< (CV_8UC1) empty with a fault; its memory is used again
  std::string name;   ///< file, or `file#number`, or the device
  std::string fault;  ///< culprit and remedy
  /// With a fault: the picture's size, where that is not the expected one.
  std::optional<cv::Size> wrong_size;
  double retry_after = 0;    ///< with a fault: before this nothing will have changed [s]
  std::uint64_t number = 0;  ///< counted from 0, faults included
};

/// A camera that may be unplugged, as a source of frames uses it.
class VideoDevice {
 public:
  /// What came of reading.
  enum class Read {
    kPicture,
    kBroken,  ///< this picture is of no use; the next may be
    kGone,    ///< no more pictures until it is opened again
  };

  virtual ~VideoDevice() = default;
  /// @return nothing when it is open, else why it is not and what to do.
  virtual std::optional<std::string> open() = 0;
  /// Waits for the next picture.
  /// @param gray   (CV_8UC1) where this gives a picture.
  /// @param fault  where it does not: why, and what to do.
  virtual Read read(cv::Mat& gray, std::string& fault) = 0;
  virtual void close() = 0;
};

/// Gray pictures, one after the other, from a webcam, a video file, a picture or a folder of
/// pictures (in the order of their names). Not for two threads at once.
class FrameSource {
 public:
  virtual ~FrameSource() = default;

  /// The next picture. A webcam's is waited for (OpenCV gives up after 10 s); nothing else is: who
  /// calls this in a loop waits for Frame::retry_after in its own way, so that it can be woken.
  virtual FrameStatus next(Frame& frame) = 0;
  /// True where one frame follows the other in time; false where each stands alone.
  virtual bool continuous() const = 0;

  /// Unplugged cameras are opened again as soon as they are back; a camera that does not take the
  /// size, the format or the locks is a fault as well. None of them throws.
  /// @throws std::invalid_argument naming the value and its rule.
  static std::unique_ptr<FrameSource> webcam(const WebcamConfig& config);
  /// The same with any device.
  /// @param reconnect_after  between tries to open it again [s].
  /// @param now              a clock that never jumps [s].
  static std::unique_ptr<FrameSource> camera(std::unique_ptr<VideoDevice> device,
                                             const std::string& name, double reconnect_after,
                                             std::function<double()> now);
  /// A broken picture or video is a fault that names it; so is, by its header and before it is
  /// decoded, one of more pixels than JpegDecoder::kMaxPixels, or of another size than expected.
  /// @param expected  [px]; none: any.
  /// @throws std::invalid_argument when there is no such file or folder, or nothing in it that
  /// could be a picture.
  static std::unique_ptr<FrameSource> files(const std::string& path,
                                            std::optional<cv::Size> expected = {});

 protected:
  void begin(Frame& frame, const std::string& name);
  static FrameStatus fail(Frame& frame, const std::string& fault, double retry_after = 0);

  std::uint64_t number_ = 0;  ///< of the next frame
};

}  // namespace helix_arm::vision
