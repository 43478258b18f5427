#pragma once

#include <algorithm>
#include <chrono>
#include <cmath>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <variant>

#include <opencv2/core.hpp>
#include <ros/time.h>

#include "basics/mutex.hpp"
#include "helix_arm/control/target_check.hpp"
#include "helix_arm/io/scene.hpp"
#include "helix_arm/model/curve.hpp"
#include "helix_arm/model/shape.hpp"
#include "observations.hpp"
#include "picture_source.hpp"
#include "procedures/loop_config.hpp"
#include "ros_bridge/common/conversions.hpp"
#include "ros_bridge/common/diagnostics.hpp"
#include "ros_bridge/common/guarded_callbacks.hpp"

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
                  VisionStatusPublisher& status)
      : stale_after_(stale_after),
        source_(source),
        status_(status),
        current_(std::move(first)),
        start_(restingShape(current_.scene)) {}

  /// Measures the shape. For one thread.
  /// @return why the picture is not taken, or what was seen in it.
  CheckedPicture<Measurement> measure(const Picture& picture) HELIX_ARM_EXCLUDES(mutex_) {
    adoptNext();
    const auto* const bodies = std::get_if<BodySet>(&picture.content);
    cv::Mat gray;
    if (bodies == nullptr) {
      CheckedPicture<cv::Mat> taken = take(picture);
      if (auto* refusal = std::get_if<PictureRefusal>(&taken)) return std::move(*refusal);
      gray = std::get<cv::Mat>(taken);
    }
    follow(picture.stamp);
    // Poses come too often to wait for models.
    auto model = match(picture.stamp, bodies == nullptr ? patience_ : std::chrono::milliseconds(0));
    if (!gray.empty() && model &&
        frozen_watch_.isFrozen(gray, model::tipPose(model->shape).translation)) {
      return PictureRefusal{PictureFault::kSource,
                            "the camera sends the same picture again and again, although the model "
                            "has moved: it hangs; restart its node, or plug it in anew"};
    }
    vision::ArmLocalizer& localizer = *current_.localizer;
    const vision::Observation& observation = bodies == nullptr
                                                 ? localizer.locate(gray, start_)
                                                 : localizer.locate(bodies->poses, start_);
    return Measurement{picture.stamp,         gray,
                       observation,           localizer.view(),
                       current_.scene.vision, std::move(model),
                       calibration_,          bodies == nullptr ? std::string() : bodies->frame};
  }

  /// Another file of the same rig, used from the next picture on. From any thread.
  void adopt(SceneLocalizer next) HELIX_ARM_EXCLUDES(mutex_) {
    const basics::MutexLock lock(mutex_);
    next_ = std::move(next);
  }
  /// From any thread.
  void addModel(const ros::Time& stamp, const model::Shape& shape) HELIX_ARM_EXCLUDES(mutex_) {
    const basics::MutexLock lock(mutex_);
    models_.add(stamp, shape);
    changed_.notifyAll();
  }
  /// Adds the shape as visual_servo estimates it. From any thread.
  void addEstimate(const ros::Time& stamp, const model::Shape& shape) HELIX_ARM_EXCLUDES(mutex_) {
    const basics::MutexLock lock(mutex_);
    estimates_.add(stamp, shape);
  }
  /// From any thread: measure() waits for no model any more.
  void stop() HELIX_ARM_EXCLUDES(mutex_) {
    const basics::MutexLock lock(mutex_);
    stop_ = true;
    changed_.notifyAll();
  }

 private:
  /// Expected shape before the first model arrives.
  static model::Shape restingShape(const io::Scene& scene) {
    const Eigen::VectorXd rest = scene.arm.inputAt(0);
    const statics::Solution solution = scene.model.solve(rest);
    if (!solution.converged()) {
      logWarning(
          "%s: the model finds no shape of the resting arm (%s, residual %.2g): tags are expected "
          "where they are without load until a model is received",
          scene.name.c_str(), statics::nameOf(solution.status), solution.residual);
    }
    return statics::startingShape(scene.model, solution, rest);
  }

  void adoptNext() HELIX_ARM_EXCLUDES(mutex_) {
    const basics::MutexLock lock(mutex_);
    if (next_) current_ = std::move(*next_);
    next_.reset();
  }

  /// The picture in gray, of the size of the camera that is used for it.
  CheckedPicture<cv::Mat> take(const Picture& picture) {
    // A picture of the wrong size is refused before decoding, which may take long.
    if (const auto* jpeg = std::get_if<sensor_msgs::CompressedImageConstPtr>(&picture.content)) {
      const auto& data = (*jpeg)->data;
      const cv::Size claimed = vision::JpegDecoder::claimedSize(data.data(), data.size());
      if (!claimed.empty()) {
        if (auto refusal = adoptCamera(claimed)) return std::move(*refusal);
      }
    }
    CheckedPicture<cv::Mat> taken = decode(picture);
    if (const auto* gray = std::get_if<cv::Mat>(&taken)) {
      if (auto refusal = adoptCamera(gray->size())) return std::move(*refusal);
    }
    return taken;
  }

  CheckedPicture<cv::Mat> decode(const Picture& picture) {
    if (const auto* raw = std::get_if<sensor_msgs::ImageConstPtr>(&picture.content)) {
      return fromMsg(**raw, buffer_);
    }
    if (const auto* jpeg = std::get_if<sensor_msgs::CompressedImageConstPtr>(&picture.content)) {
      return fromMsg(**jpeg, decoder_, buffer_);
    }
    return std::get<cv::Mat>(picture.content);
  }

  /// Uses the camera that holds now, if it is of this size.
  std::optional<PictureRefusal> adoptCamera(const cv::Size& size) {
    estimation::ArmView view = current_.localizer->view();
    std::string whose = kSceneCalibration;
    if (const auto info = source_.cameraInfo()) {
      if (const auto* refusal = std::get_if<PictureRefusal>(&*info)) return *refusal;
      view.camera = std::get<estimation::Camera>(*info);
      whose = "camera_info";
    }
    if (size != cv::Size(view.camera.width, view.camera.height)) {
      return PictureRefusal{PictureFault::kWrongSize,
                            "the picture is of " + sizeText(size.width, size.height) +
                                " pixels, but " + whose + " of " +
                                sizeText(view.camera.width, view.camera.height) +
                                "; a calibration holds for one size only"};
    }
    if (!equal(view.camera, current_.localizer->view().camera)) {
      if (adoptions_.add()) {
        logInfo(
            "camera_info differs from the intrinsics in use (%lu times so far): using "
            "camera_info%s",
            adoptions_.total(),
            source_.infoPublishers() > 1
                ? "; more than one node publishes it: stop all but the camera's"
                : "");
      }
      current_.localizer = std::make_unique<vision::ArmLocalizer>(
          view, procedures::localizerConfigOf(current_.scene));
    }
    if (const std::string& topic = source_.rectifiedTopic();
        view.camera.distorts() && !topic.empty()) {
      whose += ", of a lens that distorts, but the pictures of " + topic +
               " are rectified: remap image to the camera's own";
      if (calibration_ != whose) logWarning("calibration: %s", whose.c_str());
    }
    calibration_ = whose;
    return std::nullopt;
  }

  /// The model nearest to the stamp, if there is one within ModelHistory::kReach. Waits for at most
  /// `patience` while one that is yet to come may be nearer.
  std::optional<ModelHistory::Entry> match(const ros::Time& stamp,
                                           std::chrono::milliseconds patience)
      HELIX_ARM_EXCLUDES(mutex_) {
    basics::MutexLock lock(mutex_);
    const std::optional<double> ahead = models_.lag(stamp);
    models_.forgetFuture(stamp);
    const bool waits = patience.count() > 0 && models_.mayGetNearer(stamp);
    const auto due = std::chrono::steady_clock::now() + patience;
    const bool in_time = changed_.waitUntil(lock, due, [&]() HELIX_ARM_REQUIRES(mutex_) {
      return stop_ || patience.count() == 0 || !models_.mayGetNearer(stamp);
    });
    const std::optional<double> behind = models_.lag(stamp), lag = behind ? behind : ahead;
    std::optional<ModelHistory::Entry> found = models_.nearest(stamp);
    estimates_.forgetFuture(stamp);
    const std::optional<ModelHistory::Entry> estimate = estimates_.nearest(stamp);
    lock.unlock();
    if (!in_time) {
      patience_ = std::max(kLeastPatience, patience_ / 2);
    } else if (waits) {
      patience_ = std::min(kLongestPatience, 2 * patience_);
    }
    status_.modelLag(lag);
    const bool is_late = lag && (!in_time || std::abs(*lag) > ModelHistory::kReach);
    if (is_late && late_models_.add()) {
      logWarning(
          "models are stamped %.3f s %s the pictures (%lu times so far): is pressure_command "
          "running? If so, %s. Without a shape that balances the load there is no model: see `%s` "
          "in its diagnostics",
          std::abs(*lag), *lag < 0 ? "after" : "before", late_models_.total(),
          control::whyLate(std::abs(*lag)), names::kModelStatus);
    }
    if (found) start_ = found->shape;
    // The tips that visual_servo compares have the same deviations from the mean twists.
    if (found && estimate) start_ = estimate->shape.about(found->shape.twists());
    return found;
  }

  /// Forgets what a gap or a jump back in time makes useless.
  void follow(const ros::Time& stamp) {
    const double elapsed = secondsBetween(last_stamp_, stamp);
    if (elapsed > stale_after_) current_.localizer->reset();
    if (elapsed < 0) {
      current_.localizer->forget();  // a recording that is played again gives the same again
      frozen_watch_.reset();
      if (jumps_.add()) {
        logInfo(
            "the time of the pictures jumped back by %.1f s (%lu times so far): tracking "
            "restarts%s",
            -elapsed, jumps_.total(),
            source_.publishers() > 1 ? "; more than one node publishes pictures: stop all but one"
                                     : "");
      }
      start_ = restingShape(current_.scene);
    }
    last_stamp_ = stamp;
  }

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
