#pragma once

#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "helix_arm/vision/frame_source.hpp"

namespace helix_arm::cli {

/// The word in place of files that means a camera at this machine.
inline constexpr char kWebcam[] = "webcam";

/// What `helix_arm camera` reads pictures from.
struct CameraSource {
  std::vector<std::string> sources;  ///< files and folders, or kWebcam alone
  vision::WebcamConfig webcam;
  std::optional<cv::Size> expected;  ///< size of pictures in files; absent: any
  double seconds = 120;              ///< longest time for a webcam [s]

  bool isWebcam() const { return sources.size() == 1 && sources[0] == kWebcam; }
};

/// Why a picture could not be used, without its name.
struct PictureFault {
  explicit PictureFault(const vision::Frame& frame);
  std::string name;
  std::string reason;
};

/// How reading ended.
struct PicturesRead {
  int pictures = 0;
  std::vector<PictureFault> faults;
  bool interrupted = false;  ///< by Ctrl-C
};

/// Why there is not a single picture, naming the first file or device; nothing if there is one.
std::optional<std::string> whyNoPicture(const PicturesRead& read);

/// Reads pictures until they end, until `take` wants no more, until the time is over or until
/// Ctrl-C. A webcam that gives no picture for 5 s ends it too.
/// @param take  gets each picture and whether it follows the last one in time; returns false if it
///     wants no more.
/// @throws CallerError on kWebcam beside files, std::invalid_argument on a missing file.
PicturesRead readPictures(const CameraSource& source,
                          const std::function<bool(const vision::Frame&, bool)>& take);

}  // namespace helix_arm::cli
