#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <optional>
#include <string>
#include <variant>
#include <vector>

#include <ros/node_handle.h>
#include <ros/steady_timer.h>

#include "bag/bag_captures.hpp"
#include "helix_arm/ArmShape.h"
#include "helix_arm/PressureArray.h"
#include "helix_arm/TagDetections.h"
#include "helix_arm/VisionStatus.h"
#include "helix_arm/basics/mutex.hpp"
#include "helix_arm/basics/quote.hpp"
#include "helix_arm/basics/requirement.hpp"
#include "helix_arm/control/target_check.hpp"
#include "helix_arm/io/atomic_file.hpp"
#include "helix_arm/io/scene.hpp"
#include "helix_arm/procedures/calibration_job.hpp"
#include "helix_arm/procedures/captures.hpp"
#include "helix_arm/procedures/response_series.hpp"
#include "helix_arm/procedures/settle_watch.hpp"
#include "ros_bridge/common/diagnostics.hpp"
#include "ros_bridge/common/file_access.hpp"
#include "ros_bridge/common/guarded_callbacks.hpp"
#include "ros_bridge/common/log.hpp"
#include "ros_bridge/common/parameters.hpp"
#include "ros_bridge/common/reload_server.hpp"
#include "ros_bridge/common/ros_time.hpp"
#include "ros_bridge/names.hpp"

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
  procedures::CalibrationData data() const {
    const std::vector<io::TagCornerCapture> seen = numbered(samples, scene.arm);
    basics::require(
        !seen.empty(),
        "no sample was recorded; call record_sample or run_calibration first, or name data "
        "sets");
    procedures::CalibrationData out;
    out.captures = procedures::makeCaptures(scene, seen, "recorded samples").captures;
    out.sources.push_back({"recorded samples",
                           io::sha256Of(io::tagCornerCsv(seen, scene.arm.actuatorCount(), "")),
                           static_cast<int>(seen.size())});
    if (series.empty()) return out;
    out.tips = series;
    out.sources.push_back({"recorded series", io::sha256Of(procedures::tipSeriesCsv(series, "")),
                           static_cast<int>(series.history.rows())});
    if (left_out > 0) {
      out.warnings.push_back("the series of the tip has no room for its last " +
                             std::to_string(left_out) + " rows; expected a run of fewer steps");
    }
    return out;
  }

  /// A data set of tag corners, as CSV.
  std::string table() const {
    return io::tagCornerCsv(numbered(samples, scene.arm), scene.arm.actuatorCount(),
                            kRecordedTitle + scene.name + ", " + procedures::utcNow());
  }

  /// A data set of the series, as CSV; its times are those of the table.
  std::string seriesTable() const {
    return procedures::tipSeriesCsv(series,
                                    kRecordedTitle + scene.name + ", " + procedures::utcNow());
  }
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
  Recorder(ros::NodeHandle& node, io::Scene scene, const procedures::SettleRules& rules)
      : scene_(std::move(scene)),
        watch_(actuatorNames(scene_.arm), rules),
        detections_subscriber_(
            listen(node, names::kTagDetections, 100, &Recorder::onDetections, this)),
        measured_subscriber_(
            listen(node, names::kPressureMeasured, 100, &Recorder::onMeasured, this)),
        command_subscriber_(listen(node, names::kPressureCommand, 100, &Recorder::onCommand, this)),
        shape_subscriber_(listen(node, names::kMeasured, 100, &Recorder::onShape, this)),
        vision_subscriber_(listen(node, names::kVisionStatus, 100, &Recorder::onVision, this)),
        watch_timer_(repeat(node, "the watch", kWatchPeriod, &Recorder::onWatch, this)) {}
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
  procedures::Sample record() HELIX_ARM_EXCLUDES(mutex_) {
    const basics::MutexLock lock(mutex_);
    const procedures::Settling state = settlingAt(clock_.now());
    basics::require(state.settled(), "not recorded: ", state.reason);
    const std::vector<procedures::Sample> pictures = watch_.samples();
    const bool again = !samples_.empty() && pictures.front().time <= samples_.back().time &&
                       samples_.back().time <= pictures.back().time;
    basics::require(!again, "not recorded: the last sample is of these pictures; wait for ",
                    watch_.rules().window, " s (~window_s)");
    samples_.push_back(medianOf(pictures));
    return samples_.back();
  }
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
  std::size_t clear() HELIX_ARM_EXCLUDES(mutex_) {
    const basics::MutexLock lock(mutex_);
    const std::size_t out = samples_.size();
    samples_.clear();
    series_.reset();
    records_series_ = false;
    return out;
  }
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
  Recording recording() const HELIX_ARM_EXCLUDES(mutex_) {
    const basics::MutexLock lock(mutex_);
    Recording out{scene_, samples_, {}, 0};
    if (series_) {
      out.series = series_->series();
      out.left_out = series_->leftOut();
    }
    return out;
  }

  /// Replaces the scene; the samples stay.
  /// @throws std::invalid_argument where it is not pneumatic or of another rig; nothing changes.
  void adopt(io::Scene next) HELIX_ARM_EXCLUDES(mutex_) {
    const basics::MutexLock lock(mutex_);
    next = requirePneumatic(std::move(next));
    requireSameRig(scene_, next);
    scene_ = std::move(next);
  }

 private:
  // Callbacks of the spinning thread.
  void onDetections(const TagDetectionsConstPtr& detections) HELIX_ARM_EXCLUDES(mutex_) {
    const basics::MutexLock lock(mutex_);
    watch_.seen(detections->header.stamp.toSec(), observationsOf(*detections, scene_));
  }
  void onMeasured(const PressureArrayConstPtr& measured) HELIX_ARM_EXCLUDES(mutex_) {
    take(*measured, names::kPressureMeasured, &procedures::SettleWatch::measured);
  }
  void onCommand(const PressureArrayConstPtr& command) HELIX_ARM_EXCLUDES(mutex_) {
    take(*command, names::kPressureCommand, &procedures::SettleWatch::command);
  }
  void onShape(const ArmShapeConstPtr& shape) HELIX_ARM_EXCLUDES(mutex_) {
    const geometry_msgs::Point& tip = shape->tip.position;
    const auto checked = control::checkPosition({tip.x, tip.y, tip.z});
    const auto* position = std::get_if<Eigen::Vector3d>(&checked);
    const basics::MutexLock lock(mutex_);
    if (records_series_ && position) series_->seen(shape->header.stamp.toSec(), *position);
  }
  void onVision(const VisionStatusConstPtr& status) HELIX_ARM_EXCLUDES(mutex_) {
    const basics::MutexLock lock(mutex_);
    vision_ = *status;
  }
  void onWatch(const ros::SteadyTimerEvent&) HELIX_ARM_EXCLUDES(mutex_) {
    const basics::MutexLock lock(mutex_);
    clock_.now();
  }

  static constexpr double kWatchPeriod = 0.1;  // [s]

  static std::vector<std::string> actuatorNames(const model::Arm& arm) {
    std::vector<std::string> out;
    for (int i = 0; i < arm.actuatorCount(); ++i) out.push_back(arm.actuator(i).name);
    return out;
  }

  using Input = void (procedures::SettleWatch::*)(double time, const Eigen::VectorXd& pressure);
  /// Hands a message's pressures to the watch; warns where they are not of the scene.
  void take(const PressureArray& message, const char* topic, Input input)
      HELIX_ARM_EXCLUDES(mutex_) {
    std::string scene, fault;
    unsigned long times = 0;
    {
      const basics::MutexLock lock(mutex_);
      const auto checked = control::checkReading(scene_.arm, message.name, message.pressure);
      if (const auto* pressure = std::get_if<Eigen::VectorXd>(&checked)) {
        const double time = message.header.stamp.toSec();
        (watch_.*input)(time, *pressure);
        const bool reading = input == &procedures::SettleWatch::measured;
        if (records_series_ && reading) series_->measured(time, *pressure);
        return;
      }
      if (!foreign_pressures_.add()) return;
      scene = scene_.name;
      fault = std::get<control::Refusal>(checked).message;
      times = foreign_pressures_.total();
    }
    logWarning("%s does not match scene %s: %s (%lu times so far)", topic, scene.c_str(),
               fault.c_str(), times);
  }
  procedures::Settling settlingAt(double now) const HELIX_ARM_REQUIRES(mutex_) {
    procedures::Settling out = watch_.at(now);
    // If no tags are seen, vision_status knows the cause.
    const bool blind = out.stale() || out.state == procedures::SettleState::kNoTags;
    if (blind && vision_ && vision_->state != VisionStatus::MEASURED) {
      out.reason += "; vision says: " + basics::quoted(vision_->message, kLongestMessage);
    }
    return out;
  }

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
