#pragma once

#include <algorithm>
#include <array>
#include <cmath>

#include "helix_arm/ArmShape.h"
#include "helix_arm/BodyPoses.h"
#include "helix_arm/ModelError.h"
#include "helix_arm/TagDetections.h"
#include "helix_arm/VisionStatus.h"
#include "helix_arm/vision/arm_localizer.hpp"
#include "pictures.hpp"
#include "ros_bridge/common/arm_frames.hpp"
#include "ros_bridge/common/arm_markers.hpp"
#include "ros_bridge/common/guarded_callbacks.hpp"

/// Observations in pictures, as messages, words and drawings.
namespace helix_arm::ros_bridge {

/// The model's shapes of the last seconds, to find the one at the time of a picture.
class ModelHistory {
 public:
  struct Entry {
    ros::Time stamp;
    model::Shape shape;
  };

  /// Maximum time between a picture and its model [s].
  static constexpr double kReach = 0.25;
  /// Time for which shapes are kept, by their stamps [s].
  static constexpr double kMemory = 2.0;
  /// Maximum number of shapes: kMemory of models at 1000 Hz.
  static constexpr std::size_t kMost = 2000;

  /// A stamp before the last one is a jump back in time: all earlier entries are forgotten. A stamp
  /// equal to the last one (stopped clock) replaces its entry.
  void add(const ros::Time& stamp, const model::Shape& shape) {
    if (!entries_.empty() && stamp < entries_.back().stamp) entries_.clear();
    if (!entries_.empty() && stamp == entries_.back().stamp) entries_.pop_back();
    entries_.push_back({stamp, shape});
    if (entries_.size() > kMost) entries_.pop_front();
    while (secondsBetween(entries_.front().stamp, stamp) > kMemory) entries_.pop_front();
  }

  /// Forgets entries more than kReach ahead of `now`: they are from before a jump back in time.
  void forgetFuture(const ros::Time& now) {
    while (!entries_.empty() && secondsBetween(now, entries_.back().stamp) > kReach)
      entries_.pop_back();
  }

  /// Time of the latest model behind the stamp, negative if ahead [s]; nothing without a model.
  std::optional<double> lag(const ros::Time& stamp) const {
    if (entries_.empty()) return std::nullopt;
    return secondsBetween(entries_.back().stamp, stamp);
  }

  /// The nearest entry within kReach; the earlier of two equally near ones.
  std::optional<Entry> nearest(const ros::Time& stamp) const {
    const auto distance = [&](const Entry& entry) {
      return std::abs(secondsBetween(entry.stamp, stamp));
    };
    const auto found =
        std::min_element(entries_.begin(), entries_.end(),
                         [&](const Entry& a, const Entry& b) { return distance(a) < distance(b); });
    if (found == entries_.end() || distance(*found) > kReach) return std::nullopt;
    return *found;
  }

  /// True if a future model may be nearer: models are arriving, and none is as late as the stamp.
  bool mayGetNearer(const ros::Time& stamp) const {
    return !entries_.empty() && entries_.back().stamp < stamp &&
           secondsBetween(entries_.back().stamp, stamp) <= kReach;
  }

 private:
  std::deque<Entry> entries_;  ///< by ascending stamp
};

/// Observation in one picture, and what it is compared with. It refers to memory of the picture and
/// of the PictureMeasurer: valid as long as its picture, until the next one is measured.
struct Measurement {
  ros::Time stamp;  ///< of the picture
  cv::Mat gray;     ///< (CV_8UC1); empty without a camera
  const vision::Observation& observation;
  const estimation::ArmView& view;           ///< camera and tags that it was measured with
  const vision::LocalizerConfig& config;     ///< that it was measured with
  std::optional<ModelHistory::Entry> model;  ///< of the picture's time
  std::string calibration;                   ///< whose intrinsics were used
  std::string frame;                         ///< of the poses; empty with a camera

  bool measured() const { return observation.state == vision::ObservationState::kMeasured; }
  /// Null where there is no model of the picture's time.
  const model::Shape* modelShape() const { return model ? &model->shape : nullptr; }
};

/// All that is published of one picture, except frames and drawings.
struct ObservationReport {
  int tags = 0;  ///< of the arm in sight, each seen once
  /// Account of what is seen: the summary where the shape is measured, else why it is not and what
  /// to check; and the ids of tags that no fit can use.
  std::string account;
  TagDetections detections;         ///< camera frame; in the order of Observation::detections
  std::optional<BodyPoses> bodies;  ///< absent with a camera
  std::optional<ArmShape> shape;    ///< base frame; only if measured
  std::optional<ModelError> error;  ///< measured shape less the model's; only if both are known
  std::string tip;                  ///< short text about the tip; empty unless measured
  std::vector<std::string> lines;   ///< for the overlay
};

/// Whose intrinsics are used, in words, while no camera_info holds.
inline constexpr char kSceneCalibration[] = "the scene's camera";

/// Knows the state of the vision node, and publishes vision_status, /diagnostics and
/// measured_markers: the markers are shown only in state `measured`. From any thread.
class VisionStatusPublisher {
 public:
  /// @param name         of the node, as in the names of the diagnostics.
  /// @param base_frame   of the arm; the markers' frame.
  /// @param source       of the pictures, in words.
  /// @param of_bodies    sets of poses are received in place of pictures.
  /// @param stale_after  time without pictures [s].
  /// @param draw_period  [s].
  VisionStatusPublisher(ros::NodeHandle& node, const std::string& name,
                        const std::string& base_frame, const std::string& source,
                        double stale_after = 1.0, double draw_period = 1.0, bool of_bodies = false);

  /// A picture has come.
  void arrived() HELIX_ARM_EXCLUDES(mutex_) {
    const basics::MutexLock lock(mutex_);
    last_arrival_ = ros::SteadyTime::now();
    source_fault_ = false;
    refused_since_ = 0;
    ++status_.pictures;
  }
  /// A picture that waited was replaced by a newer one.
  void skipped() HELIX_ARM_EXCLUDES(mutex_) {
    const basics::MutexLock lock(mutex_);
    ++status_.skipped;
  }
  /// Counts a refusal; the state stays.
  void count(const PictureRefusal& refusal) HELIX_ARM_EXCLUDES(mutex_) {
    const basics::MutexLock lock(mutex_);
    countLocked(refusal);
  }
  /// A picture is not taken: counts this, except a bad camera_info, which was counted when it came.
  /// The state is camera_fault from now on.
  void refuse(const PictureRefusal& refusal) HELIX_ARM_EXCLUDES(mutex_) {
    const basics::MutexLock lock(mutex_);
    if (refusal.fault == PictureFault::kSource) source_fault_ = true;
    if (refusal.fault != PictureFault::kBadCameraInfo) countLocked(refusal);
    enterLocked(VisionStatus::CAMERA_FAULT, refusal.message);
  }
  /// How far the models' stamps are behind the last picture's [s]; nothing without models.
  void modelLag(std::optional<double> lag) HELIX_ARM_EXCLUDES(mutex_) {
    const basics::MutexLock lock(mutex_);
    model_lag_ = lag;
  }
  /// A picture was measured: the state follows from what was seen in it.
  void saw(const Measurement& measurement, const ObservationReport& report)
      HELIX_ARM_EXCLUDES(mutex_);
  /// The arm whose shape is shown from now on.
  void lookAt(const io::Scene& scene) HELIX_ARM_EXCLUDES(mutex_) {
    const basics::MutexLock lock(mutex_);
    view_ = sideViewOf(scene);
  }
  /// Shows a measured shape. Nothing is shown once another state was entered.
  void drawMarkers(const Measurement& measurement, const std::string& tip_text)
      HELIX_ARM_EXCLUDES(mutex_) {
    const basics::MutexLock lock(mutex_);
    if (!measured()) return;
    marker_publisher_.publish(markers_.draw(measurement.stamp, view_, measurement.view.layout,
                                            measurement.observation.fit, measurement.modelShape(),
                                            tip_text));
  }
  /// The state from now on: one of VisionStatus.
  void enter(std::uint8_t state, const std::string& message) HELIX_ARM_EXCLUDES(mutex_) {
    const basics::MutexLock lock(mutex_);
    enterLocked(state, message);
  }
  /// Enters the state stale if no picture has come for stale_after, by a steady clock; to be called
  /// often. Not before the first picture, after the end of a file or while the source has a fault.
  void watch() HELIX_ARM_EXCLUDES(mutex_) {
    const basics::MutexLock lock(mutex_);
    const double silence = (ros::SteadyTime::now() - last_arrival_).toSec();
    if (silence < stale_after_ || status_.state == VisionStatus::ENDED) return;
    if (of_bodies_ && refused_since_ > 0) {
      return enterLocked(VisionStatus::CAMERA_FAULT, status_.last_fault);
    }
    if (status_.pictures == 0 || source_fault_) return;
    enterLocked(
        VisionStatus::STALE,
        std::string("no ") + input_ + " was received for " + fixed(silence) + " s: " +
            (of_bodies_ ? "does the motion-capture system stream, and is its driver running?"
                        : "is the camera plugged in, and its node running?"));
  }
  /// From now on no other state is entered. @param fault  enters camera_fault before; empty: none.
  void close(const std::string& fault = {}) HELIX_ARM_EXCLUDES(mutex_) {
    const basics::MutexLock lock(mutex_);
    if (!fault.empty()) enterLocked(VisionStatus::CAMERA_FAULT, fault);
    closed_ = true;
  }

  /// Publishes status and diagnostics; to be called once a second.
  /// @param scene  of the node.
  void report(const io::Scene& scene) HELIX_ARM_EXCLUDES(mutex_) {
    const basics::MutexLock lock(mutex_);
    const ros::SteadyTime now = ros::SteadyTime::now();
    const double seconds = (now - std::exchange(last_report_, now)).toSec();
    diagnostics_.publish(node_name_, scene, {cameraStatus(seconds), measurementStatus(seconds)});
    reported_ = status_;
    publishStatusLocked();
  }

 private:
  bool measured() const HELIX_ARM_REQUIRES(mutex_) {
    return status_.state == VisionStatus::MEASURED;
  }
  /// Warnings come once in a while however often their reason does.
  void countLocked(const PictureRefusal& refusal) HELIX_ARM_REQUIRES(mutex_);
  /// Does nothing after close().
  void enterLocked(std::uint8_t state, const std::string& message) HELIX_ARM_REQUIRES(mutex_);
  /// Status of the pictures, and of what is seen in them.
  diagnostic_msgs::DiagnosticStatus cameraStatus(double seconds) HELIX_ARM_REQUIRES(mutex_);
  diagnostic_msgs::DiagnosticStatus measurementStatus(double seconds) const
      HELIX_ARM_REQUIRES(mutex_);
  void publishStatusLocked() HELIX_ARM_REQUIRES(mutex_) {
    VisionStatus status = status_;
    status.header.stamp = ros::Time::now();
    status_publisher_.publish(status);
  }

  const std::string node_name_;
  const double stale_after_;
  const bool of_bodies_;
  const char* const input_ = of_bodies_ ? "pose" : "picture";

  // Locked while publishing, too: the last message on a topic tells of the last state.
  basics::Mutex mutex_;
  VisionMarkers markers_ HELIX_ARM_GUARDED_BY(mutex_);
  SideView view_ HELIX_ARM_GUARDED_BY(mutex_) = sideView(Eigen::Vector3d::UnitX(), 0.3, 0.03);
  VisionStatus status_ HELIX_ARM_GUARDED_BY(mutex_);
  VisionStatus reported_ HELIX_ARM_GUARDED_BY(mutex_);  ///< at the last report
  unsigned long reported_faults_ HELIX_ARM_GUARDED_BY(mutex_) = 0;
  /// Whose intrinsics hold, in words.
  std::string calibration_ HELIX_ARM_GUARDED_BY(mutex_) = kSceneCalibration;
  std::optional<double> model_lag_ HELIX_ARM_GUARDED_BY(mutex_);
  std::array<FaultCount, kPictureFaultCount> faults_ HELIX_ARM_GUARDED_BY(mutex_);
  std::array<FaultCount, VisionStatus::ENDED + 1> states_ HELIX_ARM_GUARDED_BY(mutex_);
  bool closed_ HELIX_ARM_GUARDED_BY(mutex_) = false;
  bool source_fault_ HELIX_ARM_GUARDED_BY(mutex_) = false;     ///< of the webcam or file, last time
  int refused_since_ HELIX_ARM_GUARDED_BY(mutex_) = 0;         ///< since the last arrival
  ros::SteadyTime last_arrival_ HELIX_ARM_GUARDED_BY(mutex_);  ///< of a picture
  ros::SteadyTime last_report_ HELIX_ARM_GUARDED_BY(mutex_);
  ros::Publisher status_publisher_ HELIX_ARM_GUARDED_BY(mutex_);
  ros::Publisher marker_publisher_ HELIX_ARM_GUARDED_BY(mutex_);
  DiagnosticsPublisher diagnostics_ HELIX_ARM_GUARDED_BY(mutex_);
};

/// All that is published of a picture.
/// @param base_frame    of the arm.
/// @param camera_frame  of the picture.
ObservationReport reportOf(const Measurement& measurement, const std::string& base_frame,
                           const std::string& camera_frame);

/// Draws over a picture what was seen in it.
///
/// Tags are outlined, with their ids: light blue, red where they do not fit, grey where not the
/// arm's or seen twice. The measured curve is solid, the model's dashed; lines of text are below.
/// @return (CV_8UC3), BGR.
cv::Mat drawOverlay(const Measurement& measurement, const ObservationReport& report);

}  // namespace helix_arm::ros_bridge
