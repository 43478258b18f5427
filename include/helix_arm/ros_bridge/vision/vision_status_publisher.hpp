#pragma once

#include <cstdint>
#include <mutex>
#include <optional>
#include <string>

#include <ros/node_handle.h>
#include <ros/time.h>

#include "helix_arm/ros_bridge/vision/measurement.hpp"
#include "helix_arm/ros_bridge/vision/pictures.hpp"
#include "helix_arm/ros_bridge/vision/sights.hpp"
#include "helix_arm/ros_bridge/vision/vision_ledger.hpp"
#include "helix_arm/ros_bridge/vision/vision_markers.hpp"
#include "helix_arm/ros_bridge/vision/vision_options.hpp"

namespace helix_arm::ros_bridge {

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
  void arrived();
  /// A picture that waited was replaced by a newer one.
  void skipped();
  /// Counts a refusal; the state stays.
  void count(const PictureRefusal& refusal);
  /// A picture is not taken: counts this, except a bad camera_info, which was counted when it came.
  /// The state is camera_fault from now on.
  void refuse(const PictureRefusal& refusal);
  /// How far the models' stamps are behind the last picture's [s]; nothing without models.
  void modelLag(std::optional<double> lag);
  /// A picture was measured: the state follows from what was seen in it.
  void saw(const Measurement& measurement, const SightReport& report);
  /// Shows a measured shape. Nothing is shown once another state was entered.
  void drawMarkers(const Measurement& measurement, const std::string& tip_text);
  /// The state from now on: one of VisionStatus.
  void enter(std::uint8_t state, const std::string& message);

  /// Enters the state stale if no picture has come for VisionOptions::stale_after, by a steady
  /// clock; to be called often. Not before the first picture, after the end of a file, while the
  /// source has a fault, or after stopWatching().
  void watch();
  void stopWatching();

  /// Publishes status and diagnostics; to be called once a second.
  /// @param scene  name of the scene.
  void report(const std::string& scene);

 private:
  // With mutex_ locked.
  void enterLocked(std::uint8_t state, const std::string& message);
  void publishStatusLocked();

  const std::string node_name_;
  const double stale_after_;
  const VisionMarkers markers_;

  // Locked while publishing, too: the last message on a topic tells of the last state.
  std::mutex mutex_;
  VisionLedger ledger_;           ///< guarded by mutex_
  bool watching_ = true;          ///< guarded by mutex_
  bool source_fault_ = false;     ///< guarded by mutex_: of the webcam or file, last time
  ros::SteadyTime last_arrival_;  ///< guarded by mutex_: of a picture
  ros::SteadyTime last_report_;   ///< guarded by mutex_
  ros::Publisher status_publisher_, marker_publisher_, diagnostics_publisher_;
};

}  // namespace helix_arm::ros_bridge
