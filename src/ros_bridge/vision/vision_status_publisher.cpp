#include "vision_status_publisher.hpp"

#include <algorithm>

#include "helix_arm/model/curve.hpp"
#include "ros_bridge/common/conversions.hpp"
#include "ros_bridge/common/log.hpp"
#include "ros_bridge/names.hpp"

namespace helix_arm::ros_bridge {
namespace {

using diagnostic_msgs::DiagnosticStatus;
using visualization_msgs::Marker;

constexpr std::array<const char*, 5> kNamespaces = {names::kMeasuredCurveNs, names::kModelCurveNs,
                                                    names::kTagsNs, names::kTipErrorNs,
                                                    names::kTipCovarianceNs};
constexpr std::array<LegendLine, 2> kLines = {LegendLine::kMeasured, LegendLine::kModelThen};
constexpr int kPoints = 32;       // of a curve, per section; even, since dashes are drawn in pairs
constexpr double kLine = 0.008;   // width of the measured curve, wider than the others [m]
constexpr double kOpacity = 0.5;  // of the measured curve, so that the others show through
// For an arm of 0.3 m: see SideView::scale.
constexpr double kTextHeight = 0.018;  // [m]
constexpr double kTextOffset = 0.14;   // beyond the tip and its handle [m]

std::vector<geometry_msgs::Point> pointsOf(const model::Shape& shape) {
  std::vector<geometry_msgs::Point> points;
  for (const auto& point : model::sampleToTip(shape, shape.sectionCount() * kPoints)) {
    points.push_back(toPointMsg(point.X.translation));
  }
  return points;
}

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

std::string rateText(std::uint64_t count, double seconds) {
  return fixed(static_cast<double>(count) / seconds);
}

}  // namespace

VisionMarkers::VisionMarkers(std::string base_frame, double lifetime)
    : marker_{std::move(base_frame), ros::Duration(lifetime)} {}

Marker VisionMarkers::modelCurve(const Measurement& measurement) const {
  Marker dashed = marker_(measurement.stamp, names::kModelCurveNs, Marker::LINE_LIST);
  const model::Shape* model = measurement.modelShape();
  if (model == nullptr) {
    dashed.action = Marker::DELETE;
    return dashed;
  }
  dashed.scale.x = 0.5 * kLine;
  dashed.color = color(1.0, 0.95, 0.4);
  dashed.points = pointsOf(*model);
  // Dashes are pairs; the tip of a plate or tool is one point more, whose dash begins at the end.
  if (const std::size_t count = dashed.points.size(); count % 2 == 1) {
    const geometry_msgs::Point end = dashed.points[count - 2];
    dashed.points.insert(dashed.points.end() - 1, end);
  }
  return dashed;
}

Marker VisionMarkers::outlines(const Measurement& measurement) const {
  const estimation::TagLayout& layout = measurement.view.layout;
  const estimation::TwistFit& fit = measurement.observation.fit;
  Marker tags = marker_(measurement.stamp, names::kTagsNs, Marker::LINE_LIST);
  tags.pose = toPoseMsg(fit.X_B0B);
  tags.scale.x = 0.2 * kLine;
  tags.color = color(1.0, 1.0, 1.0);
  const std::vector<lie::SE3> X_BT = estimation::tagPoses(layout, fit.shape);
  const estimation::Corners corners = layout.corners();
  for (const estimation::TagResidual& tag : fit.tags) {
    for (int k = 0; k < 8; ++k) {  // edges from corner to corner
      const Eigen::Vector2d corner = corners.col((k + 1) / 2 % 4);
      tags.points.push_back(toPointMsg(X_BT[tag.tag] * Eigen::Vector3d(corner.x(), corner.y(), 0)));
      tags.colors.push_back(tag.outlier ? color(1.0, 0.25, 0.2) : color(0.4, 1.0, 0.5));
    }
  }
  if (tags.points.empty()) tags.action = Marker::DELETE;
  return tags;
}

visualization_msgs::MarkerArray VisionMarkers::draw(const Measurement& measurement,
                                                    const std::string& text) const {
  const ros::Time& stamp = measurement.stamp;
  const estimation::TwistFit& fit = measurement.observation.fit;
  const lie::SE3 tip = fit.X_B0B * model::tipPose(fit.shape);
  visualization_msgs::MarkerArray out;

  Marker measured = marker_(stamp, names::kMeasuredCurveNs, Marker::LINE_STRIP);
  measured.pose = toPoseMsg(fit.X_B0B);
  measured.scale.x = kLine;
  measured.color = color(1.0, 0.55, 0.1, kOpacity);
  measured.points = pointsOf(fit.shape);

  Marker words = marker_(stamp, names::kTipErrorNs, Marker::TEXT_VIEW_FACING);
  words.pose.position = toPointMsg(tip.translation + view_.beyond * (kTextOffset * view_.scale));
  words.scale.z = kTextHeight * view_.scale;
  words.color = color(1.0, 0.55, 0.1);
  words.text = text;

  Marker ball = marker_(stamp, names::kTipCovarianceNs, Marker::SPHERE);
  shapeLike(fit.tip_covariance, tip.translation, ball);
  ball.color = color(1.0, 0.55, 0.1, 0.5);
  out.markers = {std::move(measured), modelCurve(measurement), outlines(measurement),
                 std::move(words), std::move(ball)};
  for (const LegendLine line : kLines) {
    out.markers.push_back(
        legendLine(line, view_, marker_(stamp, names::kLegendNs, Marker::TEXT_VIEW_FACING)));
    if (line == LegendLine::kModelThen && measurement.modelShape() == nullptr) {
      out.markers.back().action = Marker::DELETE;
    }
  }
  return out;
}

visualization_msgs::MarkerArray VisionMarkers::remove(const ros::Time& stamp) const {
  visualization_msgs::MarkerArray out;
  for (const char* ns : kNamespaces) {
    out.markers.push_back(marker_(stamp, ns, Marker::SPHERE));
    out.markers.back().action = Marker::DELETE;
  }
  for (const LegendLine line : kLines) {
    out.markers.push_back(marker_(stamp, names::kLegendNs, Marker::TEXT_VIEW_FACING));
    out.markers.back().id = static_cast<int>(line);
    out.markers.back().action = Marker::DELETE;
  }
  return out;
}

VisionStatusPublisher::VisionStatusPublisher(ros::NodeHandle& node, const VisionOptions& options,
                                             std::string node_name, const std::string& base_frame)
    : node_name_(std::move(node_name)),
      stale_after_(options.stale_after),
      markers_(base_frame, std::max(1.0, 3.0 / options.draw_rate)),
      last_arrival_(ros::SteadyTime::now()),
      last_report_(last_arrival_),
      status_publisher_(node.advertise<VisionStatus>(names::kVisionStatus, 10)),
      marker_publisher_(
          node.advertise<visualization_msgs::MarkerArray>(names::kMeasuredMarkers, 2)),
      diagnostics_(node) {
  status_.state = VisionStatus::WAITING;
  status_.message = "no picture was received yet from " + options.source;
}

std::uint64_t& VisionStatusPublisher::counterOf(PictureFault fault) {
  switch (fault) {
    case PictureFault::kBadJpeg:
      return status_.bad_jpeg;
    case PictureFault::kWrongEncoding:
      return status_.wrong_encoding;
    case PictureFault::kWrongSize:
      return status_.wrong_size;
    case PictureFault::kBadCameraInfo:
      return status_.bad_camera_info;
    case PictureFault::kBadModel:
      return status_.bad_model;
    case PictureFault::kSource:
      break;
  }
  return status_.source_faults;
}

void VisionStatusPublisher::countLocked(const PictureRefusal& refusal) {
  FaultCount& count = faults_[static_cast<std::size_t>(refusal.fault)];
  const bool tell = count.add();
  counterOf(refusal.fault) = count.total();
  status_.last_fault = refusal.message;
  if (!tell) return;
  logWarning("%s (%s, %lu so far)", refusal.message.c_str(), nameOf(refusal.fault), count.total());
}

void VisionStatusPublisher::refuse(const PictureRefusal& refusal) {
  const basics::MutexLock lock(mutex_);
  if (refusal.fault == PictureFault::kSource) source_fault_ = true;
  if (refusal.fault != PictureFault::kBadCameraInfo) countLocked(refusal);
  enterLocked(VisionStatus::CAMERA_FAULT, refusal.message);
}

void VisionStatusPublisher::saw(const Measurement& measurement, const ObservationReport& report) {
  const basics::MutexLock lock(mutex_);
  const vision::Observation& observation = measurement.observation;
  status_.unknown_ids.assign(observation.unknown_ids.begin(), observation.unknown_ids.end());
  status_.repeated_ids.assign(observation.repeated_ids.begin(), observation.repeated_ids.end());
  status_.unknown_tags += observation.unknown_ids.size();
  status_.repeated_tags += observation.repeated_ids.size();
  status_.tags = static_cast<std::uint32_t>(report.tags);
  if (measurement.measured()) ++status_.measured;
  calibration_ = measurement.calibration;
  enterLocked(stateOf(observation.state), report.account + "; calibration: " + calibration_);
}

void VisionStatusPublisher::drawMarkers(const Measurement& measurement,
                                        const std::string& tip_text) {
  const basics::MutexLock lock(mutex_);
  if (measured()) marker_publisher_.publish(markers_.draw(measurement, tip_text));
}

void VisionStatusPublisher::watch() {
  const basics::MutexLock lock(mutex_);
  const double silence = (ros::SteadyTime::now() - last_arrival_).toSec();
  if (!watching_ || silence < stale_after_ || status_.state == VisionStatus::ENDED) return;
  if (status_.pictures == 0 || source_fault_) return;
  enterLocked(VisionStatus::STALE, "no picture was received for " + fixed(silence) +
                                       " s: is the camera plugged in, and its node running?");
}

void VisionStatusPublisher::enterLocked(std::uint8_t state, const std::string& message) {
  if (failed_) return;
  const bool was_measured = measured();
  const bool changed = state != status_.state;
  status_.state = state;
  status_.message = message;
  if (state != VisionStatus::MEASURED && state != VisionStatus::FEW_TAGS &&
      state != VisionStatus::NO_TAGS && state != VisionStatus::NO_FIT) {
    status_.tags = 0;
    status_.unknown_ids.clear();
    status_.repeated_ids.clear();
  }
  if (!changed) return;
  const bool told = state == VisionStatus::CAMERA_FAULT;  // by countLocked()
  if (!told && states_.at(state).add()) {
    const bool fine = state == VisionStatus::MEASURED || state == VisionStatus::ENDED;
    logLine(fine ? ros::console::levels::Info : ros::console::levels::Warn, "%s: %s",
            nameOfState(state), message.c_str());
  }
  publishStatusLocked();
  if (was_measured) marker_publisher_.publish(markers_.remove(ros::Time::now()));
}

DiagnosticStatus VisionStatusPublisher::cameraStatus(double seconds) {
  unsigned long total = 0;
  for (const FaultCount& count : faults_) total += count.total();
  const bool news = total > std::exchange(reported_faults_, total);
  const bool down =
      status_.state == VisionStatus::STALE || status_.state == VisionStatus::CAMERA_FAULT;
  const bool waits = status_.state == VisionStatus::WAITING;
  DiagnosticStatus out =
      makeStatus("camera",
                 down            ? DiagnosticStatus::ERROR
                 : news || waits ? DiagnosticStatus::WARN
                                 : DiagnosticStatus::OK,
                 down || waits ? status_.message
                 : news        ? status_.last_fault
                               : "pictures are received",
                 {{"pictures_hz", rateText(status_.pictures - reported_.pictures, seconds)},
                  {"pictures", std::to_string(status_.pictures)},
                  {"skipped", std::to_string(status_.skipped)}});
  for (int i = 0; i < kPictureFaultCount; ++i) {
    addValue(out, nameOf(PictureFault(i)), std::to_string(faults_[i].total()));
  }
  addValue(out, "calibration", calibration_);
  addValue(out, names::kLastFaultKey, status_.last_fault);
  return out;
}

DiagnosticStatus VisionStatusPublisher::measurementStatus(double seconds) const {
  const auto ids = [](const auto& of) { return listOf({of.begin(), of.end()}); };
  return makeStatus("measurement", measured() ? DiagnosticStatus::OK : DiagnosticStatus::WARN,
                    status_.message,
                    {{"state", nameOfState(status_.state)},
                     {"measured_hz", rateText(status_.measured - reported_.measured, seconds)},
                     {"tags", std::to_string(status_.tags)},
                     {"unknown_ids", ids(status_.unknown_ids)},
                     {"repeated_ids", ids(status_.repeated_ids)},
                     {"model_lag_s", model_lag_ ? fixed(*model_lag_, 3) : ""}});
}

void VisionStatusPublisher::report(const std::string& scene) {
  const basics::MutexLock lock(mutex_);
  const ros::SteadyTime now = ros::SteadyTime::now();
  const double seconds = (now - std::exchange(last_report_, now)).toSec();
  diagnostics_.publish(node_name_, scene, {cameraStatus(seconds), measurementStatus(seconds)});
  reported_ = status_;
  publishStatusLocked();
}

void VisionStatusPublisher::publishStatusLocked() {
  VisionStatus status = status_;
  status.header.stamp = ros::Time::now();
  status_publisher_.publish(status);
}

}  // namespace helix_arm::ros_bridge
