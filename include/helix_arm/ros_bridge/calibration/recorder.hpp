#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <mutex>
#include <optional>
#include <vector>

#include <ros/node_handle.h>
#include <ros/steady_timer.h>

#include "helix_arm/PressureArray.h"
#include "helix_arm/TagDetections.h"
#include "helix_arm/VisionStatus.h"
#include "helix_arm/io/scene.hpp"
#include "helix_arm/procedures/sample.hpp"
#include "helix_arm/procedures/settle_watch.hpp"
#include "helix_arm/ros_bridge/calibration/recording.hpp"
#include "helix_arm/ros_bridge/common/diagnostics.hpp"
#include "helix_arm/ros_bridge/common/moving_clock.hpp"

namespace helix_arm::ros_bridge {

/// Listens to what is measured of an arm, tells whether it stands still and whether measurements
/// are fresh, and holds the samples. From any thread.
///
/// Subscribes to tag_detections, vision_status, pressure_measured and pressure_command.
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

  Observation observe();

  /// Adds the median of the pictures of the window.
  /// @return what was added.
  /// @throws std::invalid_argument where the arm does not stand still or is not measured, and where
  /// the last sample is of these pictures.
  procedures::Sample record();
  void add(procedures::Sample sample);
  std::size_t count() const;  ///< of the samples
  /// Forgets the samples.
  /// @return how many there were.
  std::size_t clear();

  io::Scene scene() const;
  Recording recording() const;

  /// Replaces the scene; the samples stay.
  /// @throws std::invalid_argument where it is not pneumatic or of another rig; nothing changes.
  void adopt(io::Scene next);

 private:
  // Callbacks of the spinning thread.
  void onDetections(const TagDetectionsConstPtr& detections);
  void onMeasured(const PressureArrayConstPtr& measured);
  void onCommand(const PressureArrayConstPtr& command);
  void onVision(const VisionStatusConstPtr& status);
  void onWatch(const ros::SteadyTimerEvent& event);

  // With mutex_ locked.
  procedures::Settling settlingAt(double now) const;
  /// The pressures of a message [Pa]; absent, with a warning, where they are not of the scene.
  std::optional<Eigen::VectorXd> reading(const PressureArray& message, const char* topic);

  mutable std::mutex mutex_;
  io::Scene scene_;                          ///< guarded by mutex_
  MovingClock clock_;                        ///< guarded by mutex_
  procedures::SettleWatch watch_;            ///< guarded by mutex_
  std::optional<VisionStatus> vision_;       ///< the last one; guarded by mutex_
  FaultCount foreign_pressures_;             ///< guarded by mutex_
  std::vector<procedures::Sample> samples_;  ///< guarded by mutex_

  ros::Subscriber detections_subscriber_, measured_subscriber_, command_subscriber_;
  ros::Subscriber vision_subscriber_;
  ros::SteadyTimer watch_timer_;
};

}  // namespace helix_arm::ros_bridge
