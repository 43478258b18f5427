#pragma once

#include <memory>
#include <optional>
#include <string>

#include <opencv2/core.hpp>
#include <ros/time.h>

#include "helix_arm/basics/mutex.hpp"
#include "helix_arm/io/scene.hpp"
#include "helix_arm/vision/arm_localizer.hpp"
#include "helix_arm/vision/frozen_watch.hpp"
#include "helix_arm/vision/jpeg.hpp"
#include "ros_bridge/common/diagnostics.hpp"
#include "ros_bridge/vision/measurement.hpp"
#include "ros_bridge/vision/model_matcher.hpp"
#include "ros_bridge/vision/picture_source.hpp"
#include "ros_bridge/vision/pictures.hpp"

namespace helix_arm::ros_bridge {

/// A scene with camera and tags, and the localizer that looks for them.
struct SceneLocalizer {
  io::Scene scene;
  std::unique_ptr<vision::ArmLocalizer> localizer;

  /// @throws std::invalid_argument naming the value and its rule.
  explicit SceneLocalizer(io::Scene of);
};

/// Measures the arm in one picture after another: checks size and camera, decodes, finds the model
/// of its time, tracks the tags and fits the shape.
///
/// A picture stamped before the last one is a jump back in time: nothing from before it is used.
/// One that equals the last one although the model has moved is refused: the camera hangs.
class PictureMeasurer {
 public:
  /// @param stale_after  after a longer gap between pictures tags are not tracked [s].
  /// @param source       gives the camera's calibration; outlives this.
  /// @param models       outlives this.
  PictureMeasurer(SceneLocalizer first, double stale_after, const PictureSource& source,
                  ModelMatcher& models);

  /// Measures the shape. For one thread.
  /// @return why the picture is not taken, or what was seen in it.
  CheckedPicture<Measurement> measure(const Picture& picture) HELIX_ARM_EXCLUDES(mutex_);

  /// Another file of the same rig, used from the next picture on. From any thread.
  void adopt(SceneLocalizer next) HELIX_ARM_EXCLUDES(mutex_);

 private:
  void adoptNext() HELIX_ARM_EXCLUDES(mutex_);
  /// The picture in gray, of the size of the camera that is used for it.
  CheckedPicture<cv::Mat> take(const Picture& picture);
  CheckedPicture<cv::Mat> decode(const Picture& picture);
  /// Uses the camera that holds now, if it is of this size.
  std::optional<PictureRefusal> adoptCamera(const cv::Size& size);
  /// Forgets what a gap or a jump back in time makes useless.
  void follow(const ros::Time& stamp);

  const double stale_after_;
  const PictureSource& source_;
  ModelMatcher& models_;

  // Used by the thread of the measurements only.
  SceneLocalizer current_;
  vision::FrozenWatch frozen_watch_;
  vision::JpegDecoder decoder_;
  cv::Mat buffer_;
  std::string calibration_;  ///< whose intrinsics are used
  ros::Time last_stamp_;
  FaultCount jumps_, adoptions_;

  basics::Mutex mutex_;
  std::optional<SceneLocalizer> next_ HELIX_ARM_GUARDED_BY(mutex_);
};

}  // namespace helix_arm::ros_bridge
