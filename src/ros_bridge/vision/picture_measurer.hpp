#pragma once

#include <chrono>
#include <memory>
#include <optional>
#include <string>
#include <utility>

#include <opencv2/core.hpp>
#include <ros/time.h>

#include "helix_arm/basics/mutex.hpp"
#include "helix_arm/io/scene.hpp"
#include "helix_arm/model/shape.hpp"
#include "helix_arm/procedures/loop_config.hpp"
#include "observations.hpp"
#include "picture_source.hpp"
#include "ros_bridge/common/diagnostics.hpp"

namespace helix_arm::ros_bridge {

/// A scene that is seen, and the localizer of its tags or bodies.
struct SceneLocalizer {
  io::Scene scene;
  std::unique_ptr<vision::ArmLocalizer> localizer;

  /// @throws std::invalid_argument naming the value and its rule.
  explicit SceneLocalizer(io::Scene of)
      : scene(std::move(of)),
        localizer(std::make_unique<vision::ArmLocalizer>(scene.view(),
                                                         procedures::localizerConfigOf(scene))) {}
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
  /// @param status       is told how far models are behind the pictures; outlives this.
  PictureMeasurer(SceneLocalizer first, double stale_after, const PictureSource& source,
                  VisionStatusPublisher& status);

  /// Measures the shape. For one thread.
  /// @return why the picture is not taken, or what was seen in it.
  CheckedPicture<Measurement> measure(const Picture& picture) HELIX_ARM_EXCLUDES(mutex_);

  /// Another file of the same rig, used from the next picture on. From any thread.
  void adopt(SceneLocalizer next) HELIX_ARM_EXCLUDES(mutex_);
  /// From any thread.
  void addModel(const ros::Time& stamp, const model::Shape& shape) HELIX_ARM_EXCLUDES(mutex_);
  /// Adds the shape as visual_servo estimates it. From any thread.
  void addEstimate(const ros::Time& stamp, const model::Shape& shape) HELIX_ARM_EXCLUDES(mutex_);
  /// From any thread: measure() waits for no model any more.
  void stop() HELIX_ARM_EXCLUDES(mutex_);

 private:
  void adoptNext() HELIX_ARM_EXCLUDES(mutex_);

  /// The picture in gray, of the size of the camera that is used for it.
  CheckedPicture<cv::Mat> take(const Picture& picture);
  CheckedPicture<cv::Mat> decode(const Picture& picture);

  /// Uses the camera that holds now, if it is of this size.
  std::optional<PictureRefusal> adoptCamera(const cv::Size& size);

  /// Poses come too often to wait for models.
  Measurement measureBodies(const ros::Time& stamp, const BodySet& bodies)
      HELIX_ARM_EXCLUDES(mutex_);

  /// The model nearest to the stamp, if there is one within ModelHistory::kReach. Waits for at most
  /// `patience` while one that is yet to come may be nearer.
  std::optional<ModelHistory::Entry> match(const ros::Time& stamp,
                                           std::chrono::milliseconds patience)
      HELIX_ARM_EXCLUDES(mutex_);

  /// Forgets what a gap or a jump back in time makes useless.
  void follow(const ros::Time& stamp);

  /// Time that a picture waits for the model of its stamp. At 100 Hz and more the model has arrived
  /// by then, so a replay uses the same models. Each wait in vain halves the patience, down to
  /// 5 ms: late models do not slow the pictures down.
  static constexpr std::chrono::milliseconds kLongestPatience{100}, kLeastPatience{5};

  const double stale_after_;
  const PictureSource& source_;
  VisionStatusPublisher& status_;

  // Used by the thread of the measurements only.
  SceneLocalizer current_;
  model::Shape start_;  ///< from which the search starts: the last model matched
  std::chrono::milliseconds patience_ = kLongestPatience;
  vision::FrozenWatch frozen_watch_;
  vision::JpegDecoder decoder_;
  cv::Mat buffer_;
  std::string calibration_;  ///< whose intrinsics are used
  ros::Time last_stamp_;
  FaultCount jumps_, adoptions_, late_models_;

  basics::Mutex mutex_;
  basics::Condition changed_;  ///< something guarded by mutex_ has changed
  bool stop_ HELIX_ARM_GUARDED_BY(mutex_) = false;
  ModelHistory models_ HELIX_ARM_GUARDED_BY(mutex_), estimates_ HELIX_ARM_GUARDED_BY(mutex_);
  std::optional<SceneLocalizer> next_ HELIX_ARM_GUARDED_BY(mutex_);
};

}  // namespace helix_arm::ros_bridge
