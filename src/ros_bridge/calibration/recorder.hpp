#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <optional>
#include <string>
#include <vector>

#include <ros/node_handle.h>
#include <ros/steady_timer.h>

#include "helix_arm/ArmShape.h"
#include "helix_arm/PressureArray.h"
#include "helix_arm/TagDetections.h"
#include "helix_arm/VisionStatus.h"
#include "helix_arm/basics/mutex.hpp"
#include "helix_arm/io/scene.hpp"
#include "helix_arm/procedures/calibration_job.hpp"
#include "helix_arm/procedures/response_series.hpp"
#include "helix_arm/procedures/settle_watch.hpp"
#include "ros_bridge/common/diagnostics.hpp"
#include "ros_bridge/common/ros_time.hpp"

namespace helix_arm::ros_bridge {

/// The samples that were recorded of an arm, and its scene.
struct Recording {
  io::Scene scene;
  std::vector<procedures::Sample> samples;
  procedures::ResponseSeries series;  ///< of a run in a loop; empty without one
  std::size_t left_out = 0;           ///< rows that the series has no room for

  /// What a calibration takes.
  /// @throws std::invalid_argument without samples, io::DocumentError as
  /// procedures::makeCaptures().
  procedures::CalibrationData data() const;
  /// A data set of tag corners, as CSV.
  std::string table() const;
  /// A data set of the series, as CSV; its times are those of the table.
  std::string seriesTable() const;
};

/// Listens to what is measured of an arm, tells whether it stands still and whether measurements
/// are fresh, and holds the samples. From any thread.
///
/// Subscribes to tag_detections, vision_status, measured, pressure_measured and pressure_command.
///
/// Ages and windows go by the stamps of messages and ROS time; where ROS time stands still, by a
/// steady clock (MovingClock).
class Recorder {
 public:
  /// The arm at one moment.
  struct Observation {
    double time;       ///< ROS time, or the steady clock that goes on where it stands still [s]
    bool time_stands;  ///< ROS time stands still
    procedures::Settling settling;
  };

  /// @param scene  All actuators are driven by pressure.
  /// @throws std::invalid_argument naming what breaks a rule.
  Recorder(ros::NodeHandle& node, io::Scene scene, const procedures::SettleRules& rules);
  Recorder(const Recorder&) = delete;
  Recorder& operator=(const Recorder&) = delete;

  Observation observe() HELIX_ARM_EXCLUDES(mutex_) {
    const basics::MutexLock lock(mutex_);
    const double now = clock_.now();
    return {now, clock_.stands(), settlingAt(now)};
  }

  /// Adds the median of the pictures of the window.
  /// @return what was added.
  /// @throws std::invalid_argument where the arm does not stand still or is not measured, and where
  /// the last sample is of these pictures.
  procedures::Sample record() HELIX_ARM_EXCLUDES(mutex_);
  void add(procedures::Sample sample) HELIX_ARM_EXCLUDES(mutex_) {
    const basics::MutexLock lock(mutex_);
    samples_.push_back(std::move(sample));
  }
  /// of the samples
  std::size_t count() const HELIX_ARM_EXCLUDES(mutex_) {
    const basics::MutexLock lock(mutex_);
    return samples_.size();
  }
  /// Forgets the samples and the series.
  /// @return how many samples there were.
  std::size_t clear() HELIX_ARM_EXCLUDES(mutex_);
  /// Records a series of pressures and tips, until it is stopped; forgets the one before.
  void startSeries() HELIX_ARM_EXCLUDES(mutex_) {
    const basics::MutexLock lock(mutex_);
    series_.emplace(scene_.arm.actuatorCount());
    records_series_ = true;
  }
  void stopSeries() HELIX_ARM_EXCLUDES(mutex_) {
    const basics::MutexLock lock(mutex_);
    records_series_ = false;
  }

  io::Scene scene() const HELIX_ARM_EXCLUDES(mutex_) {
    const basics::MutexLock lock(mutex_);
    return scene_;
  }
  Recording recording() const HELIX_ARM_EXCLUDES(mutex_);

  /// Replaces the scene; the samples stay.
  /// @throws std::invalid_argument where it is not pneumatic or of another rig; nothing changes.
  void adopt(io::Scene next) HELIX_ARM_EXCLUDES(mutex_);

 private:
  // Callbacks of the spinning thread.
  void onDetections(const TagDetectionsConstPtr& detections) HELIX_ARM_EXCLUDES(mutex_);
  void onMeasured(const PressureArrayConstPtr& measured) HELIX_ARM_EXCLUDES(mutex_);
  void onCommand(const PressureArrayConstPtr& command) HELIX_ARM_EXCLUDES(mutex_);
  void onShape(const ArmShapeConstPtr& shape) HELIX_ARM_EXCLUDES(mutex_);
  void onVision(const VisionStatusConstPtr& status) HELIX_ARM_EXCLUDES(mutex_) {
    const basics::MutexLock lock(mutex_);
    vision_ = *status;
  }
  void onWatch(const ros::SteadyTimerEvent&) HELIX_ARM_EXCLUDES(mutex_) {
    const basics::MutexLock lock(mutex_);
    clock_.now();
  }

  using Input = void (procedures::SettleWatch::*)(double time, const Eigen::VectorXd& pressure);
  /// Hands a message's pressures to the watch; warns where they are not of the scene.
  void take(const PressureArray& message, const char* topic, Input input)
      HELIX_ARM_EXCLUDES(mutex_);
  procedures::Settling settlingAt(double now) const HELIX_ARM_REQUIRES(mutex_);

  mutable basics::Mutex mutex_;
  io::Scene scene_ HELIX_ARM_GUARDED_BY(mutex_);
  MovingClock clock_ HELIX_ARM_GUARDED_BY(mutex_);
  procedures::SettleWatch watch_ HELIX_ARM_GUARDED_BY(mutex_);
  std::optional<VisionStatus> vision_ HELIX_ARM_GUARDED_BY(mutex_);  ///< the last one
  FaultCount foreign_pressures_ HELIX_ARM_GUARDED_BY(mutex_);
  std::vector<procedures::Sample> samples_ HELIX_ARM_GUARDED_BY(mutex_);

  std::optional<procedures::SeriesRecord> series_ HELIX_ARM_GUARDED_BY(mutex_);
  bool records_series_ HELIX_ARM_GUARDED_BY(mutex_) = false;

  ros::Subscriber detections_subscriber_, measured_subscriber_, command_subscriber_;
  ros::Subscriber shape_subscriber_, vision_subscriber_;
  ros::SteadyTimer watch_timer_;
};

}  // namespace helix_arm::ros_bridge
