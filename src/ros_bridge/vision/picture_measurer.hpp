#pragma once

#include <chrono>
#include <memory>
#include <optional>
#include <string>

#include <opencv2/core.hpp>
#include <ros/time.h>

#include "helix_arm/basics/mutex.hpp"
#include "helix_arm/io/scene.hpp"
#include "helix_arm/model/shape.hpp"
#include "helix_arm/vision/arm_localizer.hpp"
#include "helix_arm/vision/frame_source.hpp"
#include "helix_arm/vision/jpeg.hpp"
#include "observations.hpp"
#include "picture_source.hpp"
#include "pictures.hpp"
#include "ros_bridge/common/diagnostics.hpp"
#include "ros_bridge/common/model_history.hpp"
#include "vision_status_publisher.hpp"

namespace helix_arm::ros_bridge {

/// Finds the model of a picture's time, and the shape from which the search for tags starts.
class ModelMatcher {
 public:
  /// @param scene   the search starts from its resting arm until a model comes.
  /// @param status  is told how far models are behind the pictures; outlives this.
  ModelMatcher(const io::Scene& scene, VisionStatusPublisher& status);

  /// From any thread.
  void add(const ros::Time& stamp, const model::Shape& shape) HELIX_ARM_EXCLUDES(mutex_);
  /// From any thread: match() waits no more.
  void stop() HELIX_ARM_EXCLUDES(mutex_);

  // For the thread of the measurements only.

  /// The model nearest to the stamp, if there is one within ModelHistory::kReach. Waits for a
  /// limited time while one that is yet to come may be nearer.
  std::optional<ModelHistory::Entry> match(const ros::Time& stamp) HELIX_ARM_EXCLUDES(mutex_);
  /// Shape from which the search starts: the last model matched.
  const model::Shape& start() const { return start_; }
  /// The search starts from the scene's resting arm again.
  void restart(const io::Scene& scene);

 private:
  /// What the history knows of a stamp.
  struct LookUp {
    std::optional<ModelHistory::Entry> model;
    std::optional<double> lag;  ///< of the latest model [s]
    bool in_time;               ///< no nearer one was to come when the wait ended
  };
  LookUp lookUp(const ros::Time& stamp) HELIX_ARM_EXCLUDES(mutex_);
  void warnOfLag(double lag);

  VisionStatusPublisher& status_;

  // Used by the thread of the measurements only.
  model::Shape start_;
  std::chrono::milliseconds patience_;
  FaultCount late_models_;

  basics::Mutex mutex_;
  basics::Condition changed_;  ///< something guarded by mutex_ has changed
  bool stop_ HELIX_ARM_GUARDED_BY(mutex_) = false;
  ModelHistory models_ HELIX_ARM_GUARDED_BY(mutex_);
};

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
