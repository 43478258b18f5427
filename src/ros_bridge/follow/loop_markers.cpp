#include "ros_bridge/follow/loop_markers.hpp"

#include <utility>

#include "ros_bridge/common/conversions.hpp"
#include "ros_bridge/common/marker_parts.hpp"
#include "ros_bridge/common/names.hpp"

namespace helix_arm::ros_bridge {
namespace {

using visualization_msgs::Marker;

constexpr double kWantedSize = 0.016;     // [m]
constexpr double kPredictedSize = 0.008;  // [m]
constexpr double kCurveWidth = 0.004;     // between those of the model and of the measured one [m]
constexpr double kArrowLength = 0.1;      // of any force: its text tells how large it is [m]
// For an arm of 0.3 m: see SideView::scale.
constexpr double kTextHeight = 0.02;    // [m]
constexpr double kTextOffset = 0.06;    // beyond the tip, clear of the measured tip's text [m]
constexpr double kTableHeight = 0.013;  // of its letters [m]
constexpr double kTableOffset = 0.23;   // to the side of the tip, clear of the ellipsoid [m]
constexpr double kTableRise = 0.03;     // its end is clear of the measured tip's text [m]

}  // namespace

LoopMarkers::LoopMarkers(std::string base_frame, double lifetime)
    : base_frame_(std::move(base_frame)), lifetime_(lifetime) {}

void LoopMarkers::addLegend(const ros::Time& stamp, const SideView& view, LegendLine line,
                            bool drawn, visualization_msgs::MarkerArray& out) const {
  out.markers.push_back(
      legendLine(line, view, marker(stamp, names::kLegendNs, Marker::TEXT_VIEW_FACING)));
  if (!drawn) out.markers.back().action = Marker::DELETE;
}

Marker LoopMarkers::marker(const ros::Time& stamp, const char* ns, int type) const {
  std_msgs::Header header;
  header.frame_id = base_frame_;
  header.stamp = stamp;
  return makeMarker(header, ns, 0, type, lifetime_);
}

Marker LoopMarkers::ball(const ros::Time& stamp, const char* ns,
                         const std::optional<Eigen::Vector3d>& centre, double size) const {
  Marker out = marker(stamp, ns, Marker::SPHERE);
  if (!centre) {
    out.action = Marker::DELETE;
    return out;
  }
  out.pose.position = toPointMsg(*centre);
  out.scale.x = out.scale.y = out.scale.z = size;
  return out;
}

Marker LoopMarkers::arrow(const ros::Time& stamp, const Tips& tips) const {
  Marker out = marker(stamp, names::kTipForceNs, Marker::ARROW);
  if (!tips.force || !tips.predicted) {
    out.action = Marker::DELETE;
    return out;
  }
  const Eigen::Vector3d along = kArrowLength * tips.force->stableNormalized();
  out.points = {toPointMsg(*tips.predicted - along), toPointMsg(*tips.predicted)};
  out.scale.x = 0.006;
  out.scale.y = 0.016;
  out.color = color(1.0, 0.2, 0.1);
  return out;
}

Marker LoopMarkers::curve(const ros::Time& stamp, const Tips& tips) const {
  Marker out = marker(stamp, names::kPredictedCurveNs, Marker::LINE_STRIP);
  if (tips.curve.empty()) {
    out.action = Marker::DELETE;
    return out;
  }
  out.scale.x = kCurveWidth;
  out.color = color(0.2, 0.9, 1.0);
  for (const Eigen::Vector3d& point : tips.curve) out.points.push_back(toPointMsg(point));
  return out;
}

Marker LoopMarkers::words(const ros::Time& stamp, const char* ns,
                          const std::optional<Eigen::Vector3d>& place, double height,
                          const std::string& text) const {
  Marker out = marker(stamp, ns, Marker::TEXT_VIEW_FACING);
  if (!place || text.empty()) {
    out.action = Marker::DELETE;
    return out;
  }
  out.pose.position = toPointMsg(*place);
  out.scale.z = height;
  out.color = color(0.2, 0.9, 1.0);
  out.text = text;
  return out;
}

visualization_msgs::MarkerArray LoopMarkers::draw(const ros::Time& stamp, const SideView& view,
                                                  const Tips& tips) const {
  visualization_msgs::MarkerArray out;
  Marker wanted = ball(stamp, names::kWantedTipNs, tips.wanted, kWantedSize);
  wanted.color = color(1.0, 0.3, 0.9, 0.7);
  Marker predicted = ball(stamp, names::kPredictedTipNs, tips.predicted, kPredictedSize);
  predicted.color = color(0.2, 0.9, 1.0);
  Marker ellipsoid = ball(stamp, names::kPredictedCovarianceNs, tips.predicted, kPredictedSize);
  ellipsoid.color = color(0.2, 0.9, 1.0, 0.35);
  if (tips.predicted) shapeLike(tips.covariance, *tips.predicted, ellipsoid);
  const auto beside = [&](double to_right, double beyond) {
    if (!tips.predicted) return std::optional<Eigen::Vector3d>();
    const Eigen::Vector3d offset = to_right * view.right + beyond * view.beyond;
    return std::optional<Eigen::Vector3d>(*tips.predicted + offset * view.scale);
  };
  Marker table = words(stamp, names::kErrorBudgetNs, beside(kTableOffset, -kTableRise),
                       kTableHeight * view.scale, tips.budget);
  if (tips.outside) table.color = color(1.0, 0.5, 0.2);
  out.markers = {std::move(wanted),
                 std::move(predicted),
                 std::move(ellipsoid),
                 words(stamp, names::kLoopStateNs, beside(0, kTextOffset), kTextHeight * view.scale,
                       tips.text),
                 std::move(table),
                 arrow(stamp, tips),
                 curve(stamp, tips)};
  addLegend(stamp, view, LegendLine::kPredicted, !tips.curve.empty(), out);
  addLegend(stamp, view, LegendLine::kWanted, tips.wanted.has_value(), out);
  return out;
}

}  // namespace helix_arm::ros_bridge
