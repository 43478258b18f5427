#include "vision_status_publisher.hpp"

#include <algorithm>
#include <array>
#include <cstddef>
#include <utility>

#include <diagnostic_msgs/DiagnosticArray.h>

#include "helix_arm/model/curve.hpp"
#include "ros_bridge/common/conversions.hpp"
#include "ros_bridge/common/diagnostics.hpp"
#include "ros_bridge/common/marker_parts.hpp"
#include "ros_bridge/names.hpp"

namespace helix_arm::ros_bridge {
namespace {

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

}  // namespace

VisionMarkers::VisionMarkers(std::string base_frame, double lifetime)
    : base_frame_(std::move(base_frame)), lifetime_(lifetime) {}

Marker VisionMarkers::marker(const ros::Time& stamp, const char* ns, int type) const {
  const std_msgs::Header header = toHeaderMsg(stamp, base_frame_);
  return makeMarker(header, ns, 0, type, lifetime_);
}

visualization_msgs::MarkerArray VisionMarkers::draw(const Measurement& measurement,
                                                    const std::string& text) const {
  const ros::Time& stamp = measurement.stamp;
  const estimation::TagLayout& layout = measurement.view.layout;
  const estimation::TwistFit& fit = measurement.observation.fit;
  const model::Shape* model = measurement.modelShape();
  visualization_msgs::MarkerArray out;
  const std_msgs::ColorRGBA measured_color = color(1.0, 0.55, 0.1);

  Marker measured = marker(stamp, names::kMeasuredCurveNs, Marker::LINE_STRIP);
  measured.pose = toPoseMsg(fit.X_B0B);
  measured.scale.x = kLine;
  measured.color = measured_color;
  measured.color.a = static_cast<float>(kOpacity);
  measured.points = pointsOf(fit.shape);
  out.markers.push_back(std::move(measured));

  Marker dashed = marker(stamp, names::kModelCurveNs, Marker::LINE_LIST);
  if (model == nullptr) {
    dashed.action = Marker::DELETE;
  } else {
    dashed.scale.x = 0.5 * kLine;
    dashed.color = color(1.0, 0.95, 0.4);
    dashed.points = pointsOf(*model);
    // Dashes are pairs; the tip of a plate or tool is one point more, whose dash begins at the end.
    if (const std::size_t count = dashed.points.size(); count % 2 == 1) {
      const geometry_msgs::Point end = dashed.points[count - 2];
      dashed.points.insert(dashed.points.end() - 1, end);
    }
  }
  out.markers.push_back(std::move(dashed));

  Marker tags = marker(stamp, names::kTagsNs, Marker::LINE_LIST);
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
  out.markers.push_back(std::move(tags));

  const lie::SE3 tip = fit.X_B0B * model::tipPose(fit.shape);
  Marker words = marker(stamp, names::kTipErrorNs, Marker::TEXT_VIEW_FACING);
  words.pose.position = toPointMsg(tip.translation + view_.beyond * (kTextOffset * view_.scale));
  words.scale.z = kTextHeight * view_.scale;
  words.color = measured_color;
  words.text = text;
  out.markers.push_back(std::move(words));

  Marker ball = marker(stamp, names::kTipCovarianceNs, Marker::SPHERE);
  shapeLike(fit.tip_covariance, tip.translation, ball);
  ball.color = color(1.0, 0.55, 0.1, 0.5);
  out.markers.push_back(std::move(ball));
  for (const LegendLine line : kLines) {
    out.markers.push_back(
        legendLine(line, view_, marker(stamp, names::kLegendNs, Marker::TEXT_VIEW_FACING)));
    if (line == LegendLine::kModelThen && model == nullptr) {
      out.markers.back().action = Marker::DELETE;
    }
  }
  return out;
}

visualization_msgs::MarkerArray VisionMarkers::remove(const ros::Time& stamp) const {
  visualization_msgs::MarkerArray out;
  for (const char* ns : kNamespaces) {
    out.markers.push_back(marker(stamp, ns, Marker::SPHERE));
    out.markers.back().action = Marker::DELETE;
  }
  for (const LegendLine line : kLines) {
    out.markers.push_back(marker(stamp, names::kLegendNs, Marker::TEXT_VIEW_FACING));
    out.markers.back().id = static_cast<int>(line);
    out.markers.back().action = Marker::DELETE;
  }
  return out;
}

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
