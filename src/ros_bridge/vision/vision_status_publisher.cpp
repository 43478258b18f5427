#include "ros_bridge/vision/vision_status_publisher.hpp"

#include <algorithm>
#include <utility>

#include <diagnostic_msgs/DiagnosticArray.h>

#include "ros_bridge/common/diagnostics.hpp"
#include "ros_bridge/common/names.hpp"

namespace helix_arm::ros_bridge {
namespace {

std::uint8_t stateOf(vision::ObservationState state) {
  switch (state) {
    case vision::ObservationState::kMeasured:
      return VisionStatus::MEASURED;
    case vision::ObservationState::kTooFewTags:
      return VisionStatus::FEW_TAGS;
    case vision::ObservationState::kNoTags:
      return VisionStatus::NO_TAGS;
    case vision::ObservationState::kNoFit:
      break;
  }
  return VisionStatus::NO_FIT;
}

}  // namespace

VisionStatusPublisher::VisionStatusPublisher(ros::NodeHandle& node, const VisionOptions& options,
                                             std::string node_name, const std::string& base_frame)
    : node_name_(std::move(node_name)),
      stale_after_(options.stale_after),
      markers_(base_frame, std::max(1.0, 3.0 / options.draw_rate)),
      ledger_(options.source),
      last_arrival_(ros::SteadyTime::now()),
      last_report_(last_arrival_) {
  ledger_.calibrated(kSceneCalibration);
  status_publisher_ = node.advertise<VisionStatus>(names::kVisionStatus, 10);
  marker_publisher_ = node.advertise<visualization_msgs::MarkerArray>(names::kMeasuredMarkers, 2);
  diagnostics_publisher_ =
      node.advertise<diagnostic_msgs::DiagnosticArray>(names::kDiagnostics, 10);
}

void VisionStatusPublisher::arrived() {
  const basics::MutexLock lock(mutex_);
  last_arrival_ = ros::SteadyTime::now();
  source_fault_ = false;
  ledger_.picture();
}

void VisionStatusPublisher::skipped() {
  const basics::MutexLock lock(mutex_);
  ledger_.skipped();
}

void VisionStatusPublisher::count(const PictureRefusal& refusal) {
  const basics::MutexLock lock(mutex_);
  ledger_.refused(refusal);
}

void VisionStatusPublisher::refuse(const PictureRefusal& refusal) {
  const basics::MutexLock lock(mutex_);
  if (refusal.fault == PictureFault::kSource) source_fault_ = true;
  if (refusal.fault != PictureFault::kBadCameraInfo) ledger_.refused(refusal);
  enterLocked(VisionStatus::CAMERA_FAULT, refusal.message);
}

void VisionStatusPublisher::modelLag(std::optional<double> lag) {
  const basics::MutexLock lock(mutex_);
  ledger_.modelLag(lag);
}

void VisionStatusPublisher::saw(const Measurement& measurement, const ObservationReport& report) {
  const basics::MutexLock lock(mutex_);
  ledger_.saw(measurement.observation, report.tags);
  ledger_.calibrated(measurement.calibration);
  enterLocked(stateOf(measurement.observation.state),
              report.account + "; calibration: " + measurement.calibration);
}

void VisionStatusPublisher::lookAt(const io::Scene& scene) {
  const basics::MutexLock lock(mutex_);
  markers_.lookAt(sideViewOf(scene));
}

void VisionStatusPublisher::drawMarkers(const Measurement& measurement,
                                        const std::string& tip_text) {
  const basics::MutexLock lock(mutex_);
  if (ledger_.measured()) marker_publisher_.publish(markers_.draw(measurement, tip_text));
}

void VisionStatusPublisher::enter(std::uint8_t state, const std::string& message) {
  const basics::MutexLock lock(mutex_);
  enterLocked(state, message);
}

void VisionStatusPublisher::fail(const std::string& message) {
  const basics::MutexLock lock(mutex_);
  enterLocked(VisionStatus::CAMERA_FAULT, message);
  failed_ = true;
}

void VisionStatusPublisher::watch() {
  const basics::MutexLock lock(mutex_);
  const double silence = (ros::SteadyTime::now() - last_arrival_).toSec();
  if (!watching_ || silence < stale_after_ || ledger_.state() == VisionStatus::ENDED) return;
  if (ledger_.status().pictures == 0 || source_fault_) return;
  enterLocked(VisionStatus::STALE, "no picture was received for " + fixed(silence) +
                                       " s: is the camera plugged in, and its node running?");
}

void VisionStatusPublisher::stopWatching() {
  const basics::MutexLock lock(mutex_);
  watching_ = false;
}

void VisionStatusPublisher::report(const std::string& scene) {
  const basics::MutexLock lock(mutex_);
  const ros::SteadyTime now = ros::SteadyTime::now();
  diagnostic_msgs::DiagnosticArray msg;
  msg.header.stamp = ros::Time::now();
  msg.status.resize(2);
  msg.status[0].name = statusName(node_name_, names::kCameraStatus);
  msg.status[1].name = statusName(node_name_, names::kMeasurementStatus);
  for (auto& status : msg.status) status.hardware_id = scene;
  ledger_.report(msg.status[0], msg.status[1], (now - last_report_).toSec());
  last_report_ = now;
  diagnostics_publisher_.publish(msg);
  publishStatusLocked();
}

void VisionStatusPublisher::enterLocked(std::uint8_t state, const std::string& message) {
  if (failed_) return;
  const bool was_measured = ledger_.measured();
  const bool changed = ledger_.enter(state, message);
  if (changed) publishStatusLocked();
  if (changed && was_measured) marker_publisher_.publish(markers_.remove(ros::Time::now()));
}

void VisionStatusPublisher::publishStatusLocked() {
  VisionStatus status = ledger_.status();
  status.header.stamp = ros::Time::now();
  status_publisher_.publish(status);
}

}  // namespace helix_arm::ros_bridge
