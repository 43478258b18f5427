#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <string>

#include <ros/node_handle.h>
#include <ros/time.h>
#include <visualization_msgs/MarkerArray.h>

#include "helix_arm/VisionStatus.h"
#include "helix_arm/basics/mutex.hpp"
#include "observations.hpp"
#include "pictures.hpp"
#include "ros_bridge/common/diagnostics.hpp"
#include "ros_bridge/common/marker_parts.hpp"
#include "vision_options.hpp"

namespace helix_arm::ros_bridge {

/// Draws for rviz what is measured, seen from the arm's base frame, in stable namespaces and ids.
///
/// - measured_curve: solid
/// - model_curve: dashed
/// - tags: outlines of those that the shape was fitted to, red where they do not fit
/// - tip_error: what the tip's distance from the model is, as text beyond the tip
/// - legend: what the curves are, one line each in its curve's colour
/// - tip_covariance: where the tip is within two standard deviations, an ellipsoid
class VisionMarkers {
 public:
  /// @param lifetime  longer than the period of drawing [s].
  VisionMarkers(std::string base_frame, double lifetime);

  /// Of the arm whose texts are drawn from now on, in the axes of its base.
  void lookAt(const SideView& view) { view_ = view; }

  /// @param measurement  has a measured shape; without a model none is drawn.
  /// @param text         beyond the tip.
  visualization_msgs::MarkerArray draw(const Measurement& measurement,
                                       const std::string& text) const;

  /// Takes everything off the screen.
  visualization_msgs::MarkerArray remove(const ros::Time& stamp) const;

 private:
  visualization_msgs::Marker modelCurve(const Measurement& measurement) const;
  visualization_msgs::Marker outlines(const Measurement& measurement) const;

  SideView view_ = sideView(Eigen::Vector3d::UnitX(), 0.3, 0.03);
  const MarkerFrame marker_;
};

/// Whose intrinsics are used, in words, while no camera_info holds.
inline constexpr char kSceneCalibration[] = "the scene's camera";

/// Knows the state of the vision node, and publishes vision_status, /diagnostics and
/// measured_markers: the markers are shown only in state `measured`. From any thread.
class VisionStatusPublisher {
 public:
  /// @param node_name   as in the names of the diagnostics.
  /// @param base_frame  of the arm; the markers' frame.
  VisionStatusPublisher(ros::NodeHandle& node, const VisionOptions& options, std::string node_name,
                        const std::string& base_frame);

  /// A picture has come.
  void arrived() HELIX_ARM_EXCLUDES(mutex_) {
    const basics::MutexLock lock(mutex_);
    last_arrival_ = ros::SteadyTime::now();
    source_fault_ = false;
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
  void refuse(const PictureRefusal& refusal) HELIX_ARM_EXCLUDES(mutex_);
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
    markers_.lookAt(sideViewOf(scene));
  }
  /// Shows a measured shape. Nothing is shown once another state was entered.
  void drawMarkers(const Measurement& measurement, const std::string& tip_text)
      HELIX_ARM_EXCLUDES(mutex_);
  /// The state from now on: one of VisionStatus.
  void enter(std::uint8_t state, const std::string& message) HELIX_ARM_EXCLUDES(mutex_) {
    const basics::MutexLock lock(mutex_);
    enterLocked(state, message);
  }
  /// Enters the state camera_fault for good: none is entered afterwards.
  void fail(const std::string& message) HELIX_ARM_EXCLUDES(mutex_) {
    const basics::MutexLock lock(mutex_);
    enterLocked(VisionStatus::CAMERA_FAULT, message);
    failed_ = true;
  }

  /// Enters the state stale if no picture has come for VisionOptions::stale_after, by a steady
  /// clock; to be called often. Not before the first picture, after the end of a file, while the
  /// source has a fault, or after stopWatching().
  void watch() HELIX_ARM_EXCLUDES(mutex_);
  void stopWatching() HELIX_ARM_EXCLUDES(mutex_) {
    const basics::MutexLock lock(mutex_);
    watching_ = false;
  }

  /// Publishes status and diagnostics; to be called once a second.
  /// @param scene  name of the scene.
  void report(const std::string& scene) HELIX_ARM_EXCLUDES(mutex_);

 private:
  bool measured() const HELIX_ARM_REQUIRES(mutex_) {
    return status_.state == VisionStatus::MEASURED;
  }
  std::uint64_t& counterOf(PictureFault fault) HELIX_ARM_REQUIRES(mutex_);
  /// Warnings come once in a while however often their reason does.
  void countLocked(const PictureRefusal& refusal) HELIX_ARM_REQUIRES(mutex_);
  /// Does nothing after fail().
  void enterLocked(std::uint8_t state, const std::string& message) HELIX_ARM_REQUIRES(mutex_);
  /// Of the pictures, and of what is seen in them.
  diagnostic_msgs::DiagnosticStatus cameraStatus(double seconds) HELIX_ARM_REQUIRES(mutex_);
  diagnostic_msgs::DiagnosticStatus measurementStatus(double seconds) const
      HELIX_ARM_REQUIRES(mutex_);
  void publishStatusLocked() HELIX_ARM_REQUIRES(mutex_);

  const std::string node_name_;
  const double stale_after_;

  // Locked while publishing, too: the last message on a topic tells of the last state.
  basics::Mutex mutex_;
  VisionMarkers markers_ HELIX_ARM_GUARDED_BY(mutex_);
  VisionStatus status_ HELIX_ARM_GUARDED_BY(mutex_);
  VisionStatus reported_ HELIX_ARM_GUARDED_BY(mutex_);  ///< at the last report
  unsigned long reported_faults_ HELIX_ARM_GUARDED_BY(mutex_) = 0;
  /// Whose intrinsics hold, in words.
  std::string calibration_ HELIX_ARM_GUARDED_BY(mutex_) = kSceneCalibration;
  std::optional<double> model_lag_ HELIX_ARM_GUARDED_BY(mutex_);
  std::array<FaultCount, kPictureFaultCount> faults_ HELIX_ARM_GUARDED_BY(mutex_);
  std::array<FaultCount, VisionStatus::ENDED + 1> states_ HELIX_ARM_GUARDED_BY(mutex_);
  bool watching_ HELIX_ARM_GUARDED_BY(mutex_) = true;
  bool failed_ HELIX_ARM_GUARDED_BY(mutex_) = false;
  bool source_fault_ HELIX_ARM_GUARDED_BY(mutex_) = false;     ///< of the webcam or file, last time
  ros::SteadyTime last_arrival_ HELIX_ARM_GUARDED_BY(mutex_);  ///< of a picture
  ros::SteadyTime last_report_ HELIX_ARM_GUARDED_BY(mutex_);
  ros::Publisher status_publisher_ HELIX_ARM_GUARDED_BY(mutex_);
  ros::Publisher marker_publisher_ HELIX_ARM_GUARDED_BY(mutex_);
  DiagnosticsPublisher diagnostics_ HELIX_ARM_GUARDED_BY(mutex_);
};

}  // namespace helix_arm::ros_bridge
