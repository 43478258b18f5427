#include "helix_arm/ros_bridge/calibration/recorder.hpp"

#include <string>
#include <utility>
#include <variant>

#include <ros/console.h>

#include "answers.hpp"
#include "helix_arm/basics/quote.hpp"
#include "helix_arm/basics/requirement.hpp"
#include "helix_arm/control/target_check.hpp"
#include "helix_arm/ros_bridge/calibration/bag_captures.hpp"
#include "helix_arm/ros_bridge/common/guarded_callbacks.hpp"
#include "helix_arm/ros_bridge/common/names.hpp"
#include "helix_arm/ros_bridge/common/pneumatics.hpp"
#include "helix_arm/ros_bridge/common/reload_server.hpp"

namespace helix_arm::ros_bridge {
namespace {

constexpr double kWatchPeriod = 0.1;  // [s]

std::vector<std::string> actuatorNames(const model::Arm& arm) {
  std::vector<std::string> out;
  for (int i = 0; i < arm.actuatorCount(); ++i) out.push_back(arm.actuator(i).name);
  return out;
}

}  // namespace

Recorder::Recorder(ros::NodeHandle& node, io::Scene scene, const procedures::SettleRules& rules)
    : scene_(std::move(scene)),
      watch_(actuatorNames(scene_.arm), rules),
      detections_subscriber_(
          listen(node, names::kTagDetections, 100, &Recorder::onDetections, this)),
      measured_subscriber_(
          listen(node, names::kPressureMeasured, 100, &Recorder::onMeasured, this)),
      command_subscriber_(listen(node, names::kPressureCommand, 100, &Recorder::onCommand, this)),
      vision_subscriber_(listen(node, names::kVisionStatus, 100, &Recorder::onVision, this)),
      watch_timer_(repeat(node, "the watch", kWatchPeriod, &Recorder::onWatch, this)) {}

void Recorder::onDetections(const TagDetectionsConstPtr& detections) {
  const std::lock_guard<std::mutex> lock(mutex_);
  watch_.seen(detections->header.stamp.toSec(), sightingsOf(*detections, scene_));
}

std::optional<Eigen::VectorXd> Recorder::reading(const PressureArray& message, const char* topic) {
  const auto checked = control::checkReading(scene_.arm, message.name, message.pressure);
  if (const auto* pressure = std::get_if<Eigen::VectorXd>(&checked)) return *pressure;
  if (foreign_pressures_.add()) {
    ROS_WARN("%s is not of scene %s: %s (%lu times so far)", topic, scene_.name.c_str(),
             std::get<control::Refusal>(checked).message.c_str(),
             static_cast<unsigned long>(foreign_pressures_.total()));
  }
  return std::nullopt;
}

void Recorder::onMeasured(const PressureArrayConstPtr& measured) {
  const std::lock_guard<std::mutex> lock(mutex_);
  if (const auto pressure = reading(*measured, names::kPressureMeasured)) {
    watch_.measured(measured->header.stamp.toSec(), *pressure);
  }
}

void Recorder::onCommand(const PressureArrayConstPtr& command) {
  const std::lock_guard<std::mutex> lock(mutex_);
  if (const auto pressure = reading(*command, names::kPressureCommand)) {
    watch_.command(command->header.stamp.toSec(), *pressure);
  }
}

void Recorder::onVision(const VisionStatusConstPtr& status) {
  const std::lock_guard<std::mutex> lock(mutex_);
  vision_ = *status;
}

void Recorder::onWatch(const ros::SteadyTimerEvent&) {
  const std::lock_guard<std::mutex> lock(mutex_);
  clock_.now();
}

procedures::Settling Recorder::settlingAt(double now) const {
  procedures::Settling out = watch_.at(now);
  // The status of vision names the cause.
  const bool blind = out.stale() || out.state == procedures::SettleState::kNoTags;
  if (blind && vision_ && vision_->state != VisionStatus::MEASURED) {
    out.reason += "; vision says: " + basics::quoted(vision_->message, kLongestMessage);
  }
  return out;
}

Recorder::Observation Recorder::observe() {
  const std::lock_guard<std::mutex> lock(mutex_);
  const double now = clock_.now();
  return {now, clock_.stands(), settlingAt(now)};
}

procedures::Sample Recorder::record() {
  const std::lock_guard<std::mutex> lock(mutex_);
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

void Recorder::add(procedures::Sample sample) {
  const std::lock_guard<std::mutex> lock(mutex_);
  samples_.push_back(std::move(sample));
}

std::size_t Recorder::count() const {
  const std::lock_guard<std::mutex> lock(mutex_);
  return samples_.size();
}

std::size_t Recorder::clear() {
  const std::lock_guard<std::mutex> lock(mutex_);
  const std::size_t out = samples_.size();
  samples_.clear();
  return out;
}

io::Scene Recorder::scene() const {
  const std::lock_guard<std::mutex> lock(mutex_);
  return scene_;
}

Recording Recorder::recording() const {
  const std::lock_guard<std::mutex> lock(mutex_);
  return {scene_, samples_};
}

void Recorder::adopt(io::Scene next) {
  const std::lock_guard<std::mutex> lock(mutex_);
  next = requirePneumatic(std::move(next));
  requireSameRig(scene_, next);
  scene_ = std::move(next);
}

}  // namespace helix_arm::ros_bridge
