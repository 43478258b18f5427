#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>

#include <opencv2/core.hpp>

#include "helix_arm/vision/config.hpp"

namespace helix_arm::vision {

/// Result of a request for the next frame.
enum class FrameStatus {
  kFrame,  ///< a picture
  kFault,  ///< no picture: Frame::fault says why; the next call retries or continues
  kEnd,    ///< end of the file or folder
};

/// One picture, or why there is none.
struct Frame {
  cv::Mat gray;       ///< (CV_8UC1) empty with a fault; its memory is reused
  std::string name;   ///< file, or `file#number`, or the device
  std::string fault;  ///< culprit and remedy
  /// With a fault: the picture's size if it is not the expected one.
  std::optional<cv::Size> wrong_size;
  double retry_after = 0;    ///< with a fault: retrying earlier is of no use [s]
  std::uint64_t number = 0;  ///< counted from 0, faults included
};

/// A camera that may be unplugged, as FrameSource uses it.
class VideoDevice {
 public:
  /// Result of reading.
  enum class Read {
    kPicture,
    kBroken,  ///< this picture is unusable; the next one may be good
    kGone,    ///< no more pictures until the device is reopened
  };

  virtual ~VideoDevice() = default;
  /// @return the reason for failure and the remedy; empty on success.
  virtual std::optional<std::string> open() = 0;
  /// Waits for the next picture.
  /// @param gray   (CV_8UC1) set if the result is kPicture.
  /// @param fault  otherwise set to the reason and the remedy.
  virtual Read read(cv::Mat& gray, std::string& fault) = 0;
  virtual void close() = 0;
};

/// Gray pictures, one after the other, from a webcam, a video file, a picture or a folder of
/// pictures (in the order of their names). Not thread-safe.
class FrameSource {
 public:
  virtual ~FrameSource() = default;

  /// The next picture. Waits only for a webcam's picture (OpenCV gives up after 10 s). A caller
  /// that loops must itself wait for Frame::retry_after, so that it can be woken.
  virtual FrameStatus next(Frame& frame) = 0;
  /// True if the frames follow one another in time; false if they are independent.
  virtual bool continuous() const = 0;

  /// Unplugged cameras are reopened as soon as they are back. A camera that does not accept the
  /// size, the format, the focus or the exposure is a fault too. No fault throws.
  static std::unique_ptr<FrameSource> webcam(const WebcamConfig& config);
  /// Like webcam(), with any device.
  /// @param reconnect_after  time between attempts to reopen [s].
  /// @param now              monotonic clock [s].
  static std::unique_ptr<FrameSource> camera(std::unique_ptr<VideoDevice> device,
                                             const std::string& name, double reconnect_after,
                                             std::function<double()> now);
  /// A broken picture or video is a fault that names it. A picture with more pixels than
  /// JpegDecoder::kMaxPixels, or of another size than expected, is a fault too.
  /// @param expected  size of the pictures [px]; absent: any.
  /// @throws std::invalid_argument if the file or folder does not exist, or contains no picture.
  static std::unique_ptr<FrameSource> files(const std::string& path,
                                            std::optional<cv::Size> expected = {});

 protected:
  void begin(Frame& frame, const std::string& name);
  static FrameStatus fail(Frame& frame, const std::string& fault, double retry_after = 0);

  std::uint64_t number_ = 0;  ///< of the next frame
};

/// Notices a camera that hangs and sends its last picture again and again, with new stamps.
///
/// No two pictures of a real camera agree in every pixel, be it for noise alone. Those that do
/// although the model has moved since are old ones:
///
///     if (watch.isFrozen(gray, model::tipPose(model).translation)) refuse(gray);
///
/// An arm at rest is never called frozen.
class FrozenWatch {
 public:
  /// Motion of the model's tip between equal pictures that are still taken [m]. A simulated camera
  /// may have no noise: its pictures of an arm at rest agree, and the model then moves with the
  /// noise of the readings, by some millimetres.
  static constexpr double kMotion = 0.01;

  /// Takes the next picture.
  /// @param gray       (CV_8UC1), any size.
  /// @param model_tip  of the model at the picture's time, base frame [m].
  /// @return whether it equals the picture before, and the model's tip is farther than kMotion from
  ///     where it was at the first of these.
  bool isFrozen(const cv::Mat& gray, const Eigen::Vector3d& model_tip);
  /// Forgets the picture before.
  void reset() { before_.release(); }

 private:
  cv::Mat before_;
  Eigen::Vector3d tip_ = Eigen::Vector3d::Zero();  // of the model, at the first picture like that
};

}  // namespace helix_arm::vision
