#include "recorder.hpp"

#include <variant>

#include "bag/bag_captures.hpp"
#include "helix_arm/basics/quote.hpp"
#include "helix_arm/basics/requirement.hpp"
#include "helix_arm/control/target_check.hpp"
#include "helix_arm/io/atomic_file.hpp"
#include "helix_arm/procedures/captures.hpp"
#include "ros_bridge/common/file_access.hpp"
#include "ros_bridge/common/guarded_callbacks.hpp"
#include "ros_bridge/common/log.hpp"
#include "ros_bridge/common/parameters.hpp"
#include "ros_bridge/common/reload_server.hpp"
#include "ros_bridge/names.hpp"

namespace helix_arm::ros_bridge {
namespace {

constexpr char kRecorded[] = "recorded samples";
constexpr char kRecordedSeries[] = "recorded series";

constexpr double kWatchPeriod = 0.1;  // [s]

std::vector<std::string> actuatorNames(const model::Arm& arm) {
  std::vector<std::string> out;
  for (int i = 0; i < arm.actuatorCount(); ++i) out.push_back(arm.actuator(i).name);
  return out;
}

}  // namespace

procedures::CalibrationData Recording::data() const {
  const std::vector<io::TagCornerCapture> seen = numbered(samples, scene.arm);
  basics::require(
      !seen.empty(),
      "no sample was recorded; call record_sample or run_calibration first, or name data "
      "sets");
  procedures::CalibrationData out;
  out.captures = procedures::makeCaptures(scene, seen, kRecorded).captures;
  out.sources.push_back({kRecorded,
                         io::sha256Of(io::tagCornerCsv(seen, scene.arm.actuatorCount(), "")),
                         static_cast<int>(seen.size())});
  if (series.empty()) return out;
  out.tips = series;
  out.sources.push_back({kRecordedSeries, io::sha256Of(procedures::tipSeriesCsv(series, "")),
                         static_cast<int>(series.history.rows())});
  if (left_out > 0) {
    out.warnings.push_back("the series of the tip has no room for its last " +
                           std::to_string(left_out) + " rows; expected a run of fewer steps");
  }
  return out;
}

std::string Recording::table() const {
  return io::tagCornerCsv(numbered(samples, scene.arm), scene.arm.actuatorCount(),
                          kRecordedTitle + scene.name + ", " + procedures::utcNow());
}

std::string Recording::seriesTable() const {
  return procedures::tipSeriesCsv(series,
                                  kRecordedTitle + scene.name + ", " + procedures::utcNow());
}

Recorder::Recorder(ros::NodeHandle& node, io::Scene scene, const procedures::SettleRules& rules)
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

void Recorder::onDetections(const TagDetectionsConstPtr& detections) {
  const basics::MutexLock lock(mutex_);
  watch_.seen(detections->header.stamp.toSec(), observationsOf(*detections, scene_));
}

void Recorder::onShape(const ArmShapeConstPtr& shape) {
  const geometry_msgs::Point& tip = shape->tip.position;
  const auto checked = control::checkPosition({tip.x, tip.y, tip.z});
  const auto* position = std::get_if<Eigen::Vector3d>(&checked);
  const basics::MutexLock lock(mutex_);
  if (records_series_ && position) series_->seen(shape->header.stamp.toSec(), *position);
}

void Recorder::take(const PressureArray& message, const char* topic, Input input) {
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

void Recorder::onMeasured(const PressureArrayConstPtr& measured) {
  take(*measured, names::kPressureMeasured, &procedures::SettleWatch::measured);
}

void Recorder::onCommand(const PressureArrayConstPtr& command) {
  take(*command, names::kPressureCommand, &procedures::SettleWatch::command);
}

procedures::Settling Recorder::settlingAt(double now) const {
  procedures::Settling out = watch_.at(now);
  // If no tags are seen, vision_status knows the cause.
  const bool blind = out.stale() || out.state == procedures::SettleState::kNoTags;
  if (blind && vision_ && vision_->state != VisionStatus::MEASURED) {
    out.reason += "; vision says: " + basics::quoted(vision_->message, kLongestMessage);
  }
  return out;
}

procedures::Sample Recorder::record() {
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

std::size_t Recorder::clear() {
  const basics::MutexLock lock(mutex_);
  const std::size_t out = samples_.size();
  samples_.clear();
  series_.reset();
  records_series_ = false;
  return out;
}

Recording Recorder::recording() const {
  const basics::MutexLock lock(mutex_);
  Recording out{scene_, samples_, {}, 0};
  if (series_) {
    out.series = series_->series();
    out.left_out = series_->leftOut();
  }
  return out;
}

void Recorder::adopt(io::Scene next) {
  const basics::MutexLock lock(mutex_);
  next = requirePneumatic(std::move(next));
  requireSameRig(scene_, next);
  scene_ = std::move(next);
}

}  // namespace helix_arm::ros_bridge
