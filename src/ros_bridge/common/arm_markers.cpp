#include "arm_markers.hpp"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <array>
#include <cctype>
#include <cmath>
#include <cstddef>
#include <sstream>

#include "basics/text.hpp"
#include "conversions.hpp"
#include "ros_bridge/names.hpp"

namespace helix_arm::ros_bridge {
namespace {

using visualization_msgs::Marker;

constexpr double kSigmas = 2.0;
constexpr double kThinnest = 1e-4;  // rviz does not draw what has no extent [m]

constexpr double kUsualLength = 0.3;  // of an arm, for which all lengths here are given [m]
constexpr double kUpright = 0.85;     // |cosine| of the angle to the vertical of an upright arm
constexpr double kSideways = 0.2;     // horizontal part of a direction that has a side to look from
constexpr double kUsualYaw = 0.3;     // of an upright arm: from any side, and not straight on
constexpr double kUsualPitch = 0.15;  // slightly from above: the ground shows depth
constexpr double kBeside = 0.08;      // from the discs to the columns [m]
constexpr double kAbove = 0.04;       // from the discs to columns above them [m]
constexpr double kBetween = 0.17;     // from the middle of the arm to columns above it [m]
constexpr double kHalfColumn = 0.12;  // half the width of a column [m]
constexpr double kColumn = 0.17;      // height of the legend [m]
constexpr double kBanner = 0.16;      // height of state and reason [m]
constexpr double kTipTexts = 0.2;     // beyond the tip [m]
constexpr double kTipTable = 0.34;    // from the tip to the end of the loop's table [m]

// By Screen::Legend. Model and measured have the colours of the figures (scripts/plot_report).
struct LegendText {
  const char* text;
  double r, g, b;
};
constexpr std::array<LegendText, 6> kLegend = {{{"green: model", 0.18, 0.7, 0.27},
                                                {"pale green: tip trace", 0.7, 1.0, 0.75},
                                                {"orange: measured", 1.0, 0.55, 0.1},
                                                {"dashes: model at the picture", 0.18, 0.7, 0.27},
                                                {"cyan line: predicted", 0.2, 0.9, 1.0},
                                                {"magenta: wanted tip", 1.0, 0.3, 0.9}}};

constexpr int kRings = 24;               // of a tube, per section
constexpr int kSides = 10;               // of a tube
constexpr double kDisc = 0.004;          // thickness of a separator [m]
constexpr double kBaseCurve = 0.003;     // width [m]
constexpr float kMuscleOpacity = 0.45F;  // the curves inside the arm show through
// Height of letters, for an arm of 0.3 m: see SideView::scale.
constexpr double kBannerHeight = 0.022;  // [m]
constexpr double kReasonHeight = 0.012;  // [m]
constexpr double kLineHeight = 0.016;    // [m]
// Length of the state's reason. The cockpit shows all of it.
constexpr std::size_t kLongestLine = 78;  // in characters
constexpr std::size_t kMostLines = 4;
constexpr std::size_t kTraceLength = 400;
constexpr double kTraceStep = 0.002;     // between points of the trace [m]
constexpr double kTraceSmoothing = 0.3;  // weight of a new tip; a larger one makes the trace noisy

// Blue to lilac: bright enough for text on a dark background, and unlike the colours of the curves
// (kLegend), which show through the muscles.
std_msgs::ColorRGBA pressureColor(double share) {
  constexpr std::array<std::array<double, 3>, 4> kStops = {
      {{0.4, 0.65, 1.0}, {0.6, 0.6, 1.0}, {0.8, 0.62, 1.0}, {1.0, 0.8, 1.0}}};
  const double place = 3.0 * std::clamp(share, 0.0, 1.0);
  const int k = std::min(2, static_cast<int>(place));
  const double t = place - k;
  const auto mix = [&](int i) { return kStops[k][i] + t * (kStops[k + 1][i] - kStops[k][i]); };
  return color(mix(0), mix(1), mix(2));
}

// Points of the circle around a muscle, in the y-z plane of its frame, whose x axis runs along it.
Eigen::Vector3d onCircle(double radius, int side) {
  const double angle = 6.283185307179586 * side / kSides;
  return {0.0, radius * std::cos(angle), radius * std::sin(angle)};
}

// Triangles of the tube of a muscle along the curve, between two points of the curve.
// The second one is at X_last, since the curve continues there beyond a plate.
void addTube(const std::vector<model::CurvePoint<lie::SE3>>& curve, int first, int last,
             const lie::SE3& X_last, const model::Actuator& actuator, double radius,
             std::vector<geometry_msgs::Point>& triangles) {
  std::array<geometry_msgs::Point, kSides> here, next;
  for (int j = first; j <= last; ++j) {
    const double s = static_cast<double>(j - first) / (last - first);
    const lie::SE3 X = (j < last ? curve[j].X : X_last) * model::poseAlong(actuator, s);
    for (int side = 0; side < kSides; ++side) next[side] = toPointMsg(X * onCircle(radius, side));
    for (int side = 0; j > first && side < kSides; ++side) {
      const int other = (side + 1) % kSides;
      triangles.insert(triangles.end(), {here[side], here[other], next[side]});
      triangles.insert(triangles.end(), {next[side], here[other], next[other]});
    }
    here = next;
  }
}

// rviz draws cylinders along z; the axis of a separator is x.
lie::SE3 standAlongX(const lie::SE3& X) {
  Eigen::Matrix3d z_to_x;
  z_to_x << 0, 0, 1, 0, 1, 0, -1, 0, 0;
  return {X.rotation * z_to_x, X.translation};
}

// Name of an arm whose frames have a prefix, as in a namespace; otherwise empty.
std::string armNameOf(const std::string& base_frame) {
  const std::size_t end = base_frame.rfind(std::string("_") + names::kBaseFrame);
  return end == std::string::npos ? "" : base_frame.substr(0, end) + ": ";
}

// Size of a section at s, relative to that at its beginning.
double sizeAt(const model::Actuator& actuator, double s) {
  const auto radius = [&](double place) {
    return model::poseAlong(actuator, place).translation.tail<2>().norm();
  };
  return actuator.taper.empty() || radius(0) == 0 ? 1.0 : radius(s) / radius(0);
}

std::string stateText(const control::SafetyReport& report) {
  std::string out = report.stopped ? "emergency stop, " : "";
  out += control::nameOf(report.state);
  std::transform(out.begin(), out.end(), out.begin(),
                 [](unsigned char c) { return static_cast<char>(std::toupper(c)); });
  return out;
}

// A text in few lines that fit the view; its first word, the state, stands above it already.
std::vector<std::string> reasonLines(const std::string& text) {
  const std::size_t cut = text.find(": ");
  auto out = wrapped(cut == std::string::npos ? text : text.substr(cut + 2),
                     [](const std::string& line) { return line.size() <= kLongestLine; });
  if (out.size() > kMostLines) {
    out.resize(kMostLines);
    out.back() += " ...";
  }
  return out;
}

std_msgs::ColorRGBA stateColor(const control::SafetyReport& report) {
  using control::SafetyState;
  if (report.stopped || report.vent_overdue || report.state == SafetyState::kFault) {
    return color(1.0, 0.3, 0.25);
  }
  if (report.state == SafetyState::kEnabled) return color(0.4, 1.0, 0.5);
  return report.state == SafetyState::kVented ? color(1.0, 0.75, 0.3) : color(0.8, 0.8, 0.85);
}

// Markers of vision and its loop.
constexpr int kMarkerPoints = 32;  // of a curve, per section; even, since dashes are drawn in pairs
constexpr double kMeasuredCurve = 0.008;   // width, larger than the others [m]
constexpr double kTipTextHeight = 0.018;   // [m]
constexpr double kTipTextOffset = 0.14;    // beyond the tip and its handle [m]
constexpr double kWantedSize = 0.016;      // [m]
constexpr double kPredictedSize = 0.008;   // [m]
constexpr double kPredictedCurve = 0.004;  // between those of the model and of the measured one [m]
constexpr double kArrowLength = 0.1;       // of any force: its text tells how large it is [m]
constexpr double kLoopTextHeight = 0.02;   // [m]
constexpr double kLoopTextOffset = 0.06;   // beyond the tip, clear of the measured tip's text [m]
constexpr double kTableHeight = 0.013;     // of its letters [m]
constexpr double kTableOffset = 0.23;      // to the side of the tip, clear of the ellipsoid [m]
constexpr double kTableRise = 0.03;        // its end is clear of the measured tip's text [m]

std::vector<Eigen::Vector3d> pointsOf(const model::Shape& shape) {
  std::vector<Eigen::Vector3d> points;
  for (const auto& point : model::sampleToTip(shape, shape.sectionCount() * kMarkerPoints)) {
    points.push_back(point.X.translation);
  }
  return points;
}

// Centre of n lines of text whose first one is at `top`.
Eigen::Vector3d centreOfLines(const SideView& view, const Eigen::Vector3d& top, int n,
                              double height) {
  return top - 0.5 * (n - 1) * kLineSpacing * height * view.up;
}

// Line i of a column of n lines. Each is a marker with its own colour at the column's centre; empty
// lines before and after it keep the column aligned from every viewpoint.
std::string lineOfColumn(int i, int n, const std::string& text) {
  return std::string(static_cast<std::size_t>(i), '\n') + text +
         std::string(static_cast<std::size_t>(n - 1 - i), '\n');
}

using Control = visualization_msgs::InteractiveMarkerControl;
using Feedback = visualization_msgs::InteractiveMarkerFeedback;

// Name of the handle.
constexpr char kHandle[] = "tip";
constexpr double kFollowStep = 0.002;  // smaller moves are not worth a message [m]
constexpr double kHoldTimeout = 2.0;   // of an rviz that ended while it dragged the handle [s]

visualization_msgs::InteractiveMarker handle(const std::string& frame, const io::Scene& scene) {
  const double size = std::clamp(4.0 * scene.looks.back().separator_radius, 0.1, 0.15);  // [m]
  visualization_msgs::InteractiveMarker out;
  out.header.frame_id = frame;
  out.name = kHandle;
  out.description = "tip target";
  out.scale = static_cast<float>(size);
  out.pose.orientation.w = 1.0;
  // A control whose axis (or normal) is the x axis turned about another.
  const auto add = [&out](const char* name, std::uint8_t mode, double angle,
                          const Eigen::Vector3d& about) {
    Control& control = out.controls.emplace_back();
    control.name = name;
    control.interaction_mode = mode;
    control.orientation = toQuaternionMsg(Eigen::AngleAxisd(angle, about).toRotationMatrix());
  };
  const Eigen::Vector3d y = Eigen::Vector3d::UnitY(), z = Eigen::Vector3d::UnitZ();
  const bool planar = scene.planar.has_value();
  planar ? add("plane", Control::MOVE_PLANE, -M_PI / 2, y) : add("free", Control::MOVE_3D, 0, z);
  Control& grip = out.controls.back();
  grip.always_visible = true;
  Marker& ball = grip.markers.emplace_back();
  ball.type = Marker::SPHERE;
  ball.pose.orientation.w = 1.0;
  ball.scale.x = ball.scale.y = ball.scale.z = 0.2 * size;
  ball.color = color(0.4, 1.0, 0.6, 0.5);
  add("x", Control::MOVE_AXIS, 0, z);
  add("y", Control::MOVE_AXIS, M_PI / 2, z);
  if (!planar) add("z", Control::MOVE_AXIS, -M_PI / 2, y);
  return out;
}

}  // namespace

std_msgs::ColorRGBA color(double r, double g, double b, double a) {
  std_msgs::ColorRGBA out;
  out.r = static_cast<float>(r);
  out.g = static_cast<float>(g);
  out.b = static_cast<float>(b);
  out.a = static_cast<float>(a);
  return out;
}

double SideView::distance(double field_of_view, double aspect) const {
  const double half = std::tan(0.5 * field_of_view);
  // Parts nearer to the camera than the base look larger.
  constexpr double kMargin = 1.05;
  return kMargin * 0.5 * std::max(height / half, width / (half * aspect));
}

SideView sideView(const Eigen::Vector3d& axis, double length, double radius) {
  const Eigen::Vector3d along = axis.normalized();
  const double unit = length / kUsualLength, rise = along.z() * length;
  SideView out;
  out.scale = unit;
  out.pitch = kUsualPitch;
  out.up = Eigen::Vector3d::UnitZ();
  const bool upright = std::abs(along.z()) > kUpright, stands = upright && along.z() > 0;
  out.yaw =
      std::hypot(along.x(), along.y()) < kSideways ? kUsualYaw : std::atan2(-along.x(), along.y());
  out.right = Eigen::Vector3d(-std::sin(out.yaw), std::cos(out.yaw), 0);
  out.beyond = stands ? out.up : Eigen::Vector3d(-out.up);

  double top = 0, bottom = 0, left = 0, to_right = 0, column = 0, middle = 0, headline = 0;
  if (upright) {
    column = kBeside * unit + 3.0 * radius;
    // Away from the arm: above the base of one that hangs, below that of one that stands.
    headline = (stands ? -0.04 : kBanner - 0.025) * unit;
    top = stands ? rise + kTipTexts * unit : kBanner * unit;
    bottom = stands ? -kBanner * unit : rise - kTipTexts * unit;
    left = -column - kHalfColumn * unit;
    to_right = std::max(column + kHalfColumn * unit, kTipTable * unit);
  } else {
    const double reach = std::hypot(along.x(), along.y()) * length;
    middle = 0.5 * reach;
    column = kBetween * unit;
    const double base = std::max(0.0, rise) + 2.0 * radius;
    headline = base + (kAbove + kColumn + kBanner) * unit;
    top = headline + 0.03 * unit;
    bottom = std::min(0.0, rise) - kTipTexts * unit;
    left = std::min(-2.0 * radius, middle - column - kHalfColumn * unit);
    to_right = reach + kTipTable * unit;
  }
  const double first =
      upright ? (stands ? kColumn * unit : 0.0) : headline - (kBanner - 0.01) * unit;
  const auto at = [&](double x, double y) -> Eigen::Vector3d { return x * out.right + y * out.up; };
  out.headline = at(middle, headline);
  out.legend_top = at(middle - column, first);
  out.table_top = at(middle + column, first);
  out.centre = at(0.5 * (left + to_right), 0.5 * (top + bottom));
  out.width = to_right - left;
  out.height = top - bottom;
  return out;
}

SideView seenFrom(const Eigen::Matrix3d& R_WB, SideView view) {
  for (Eigen::Vector3d* vector : {&view.right, &view.up, &view.beyond, &view.headline,
                                  &view.legend_top, &view.table_top, &view.centre}) {
    *vector = R_WB.transpose() * *vector;
  }
  return view;
}

SideView sideViewOf(const io::Scene& scene) {
  const Eigen::Matrix3d& R_WB = scene.X_WB.rotation;
  return seenFrom(
      R_WB, sideView(R_WB.col(0), scene.arm.restLength(), scene.looks.front().separator_radius));
}

std::vector<std::string> wrapped(const std::string& text,
                                 const std::function<bool(const std::string& line)>& fits) {
  std::vector<std::string> lines;
  std::istringstream rest(text);
  for (std::string word; rest >> word;) {
    if (lines.empty() || !fits(lines.back() + " " + word)) {
      lines.push_back(word);
    } else {
      lines.back() += " " + word;
    }
  }
  return lines;
}

Screen::Screen(std::string frame, double period)
    : frame_(std::move(frame)), lifetime_(std::max(1.0, 3.0 * period)) {}

Marker& Screen::add(const char* ns, int type, const std_msgs::ColorRGBA& color, int id) {
  Marker& out = drawing_.markers.emplace_back();
  out.header = toHeaderMsg(stamp_, frame_);
  out.ns = ns;
  out.id = id;
  out.type = type;
  out.action = Marker::ADD;
  out.pose.orientation.w = 1.0;
  out.lifetime = lifetime_;
  out.color = color;
  return out;
}

Marker& Screen::addText(const char* ns, const Eigen::Vector3d& centre, double height,
                        const std_msgs::ColorRGBA& color, const std::string& text, int id) {
  Marker& out = add(ns, Marker::TEXT_VIEW_FACING, color, id);
  out.pose.position = toPointMsg(centre);
  out.scale.z = height;
  out.text = text;
  return out;
}

Marker& Screen::addLine(const char* ns, int type, double width, const std_msgs::ColorRGBA& color,
                        const std::vector<Eigen::Vector3d>& points) {
  Marker& out = add(ns, type, color);
  out.scale.x = width;
  for (const Eigen::Vector3d& point : points) out.points.push_back(toPointMsg(point));
  return out;
}

Marker& Screen::addBall(const char* ns, const Eigen::Vector3d& centre, double size,
                        const std_msgs::ColorRGBA& color) {
  Marker& out = add(ns, Marker::SPHERE, color);
  out.pose.position = toPointMsg(centre);
  out.scale.x = out.scale.y = out.scale.z = size;
  return out;
}

void Screen::addEllipsoid(const char* ns, const Eigen::Vector3d& centre,
                          const Eigen::Matrix3d& covariance, const std_msgs::ColorRGBA& color) {
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> solver(covariance);
  Eigen::Matrix3d axes = solver.eigenvectors();
  if (axes.determinant() < 0) axes.col(0) *= -1.0;  // right-handed
  Marker& out = add(ns, Marker::SPHERE, color);
  out.pose = toPoseMsg({axes, centre});
  const Eigen::Vector3d sigma = solver.eigenvalues().cwiseMax(0.0).cwiseSqrt();
  out.scale = toVectorMsg((2.0 * kSigmas * sigma).cwiseMax(kThinnest));
}

std_msgs::ColorRGBA Screen::addLegend(Legend line, const SideView& view, double opacity) {
  constexpr int kLines = static_cast<int>(kLegend.size());
  const LegendText& entry = kLegend[line];
  const double height = kLineHeight * view.scale;
  addText("legend", centreOfLines(view, view.legend_top, kLines, height), height,
          color(entry.r, entry.g, entry.b), lineOfColumn(line, kLines, entry.text), line);
  return color(entry.r, entry.g, entry.b, opacity);
}

visualization_msgs::MarkerArray Screen::end() {
  std::set<Key> drawn;
  for (const Marker& marker : drawing_.markers) drawn.emplace(marker.ns, marker.id);
  known_.insert(drawn.begin(), drawn.end());
  for (const Key& key : known_) {
    if (drawn.count(key) > 0) continue;
    add(key.first.c_str(), Marker::SPHERE, {}, key.second).action = Marker::DELETE;
  }
  return std::exchange(drawing_, {});
}

ArmMarkers::ArmMarkers(const io::Scene& scene, const std::string& base_frame, double period)
    : Screen(base_frame, period), scene_(scene), arm_(armNameOf(base_frame)) {}

void ArmMarkers::extendTrace(const Eigen::Vector3d& tip) {
  if (trace_.empty()) smooth_tip_ = tip;
  smooth_tip_ += kTraceSmoothing * (tip - smooth_tip_);
  if (!trace_.empty() && (smooth_tip_ - trace_.back()).norm() < kTraceStep) return;
  trace_.push_back(smooth_tip_);
  if (trace_.size() > kTraceLength) trace_.pop_front();
}

void ArmMarkers::addWords(const SideView& view) {
  const std_msgs::ColorRGBA ink = stateColor(safety_);
  const double headline = kBannerHeight * view.scale, small = kReasonHeight * view.scale;
  addText("state_banner", view.headline, headline, ink, arm_ + stateText(safety_));
  const std::vector<std::string> lines = reasonLines(reason_);
  if (!lines.empty()) {
    // The first line stays below the state, however many follow.
    const Eigen::Vector3d first = view.headline - headline * view.up;
    addText("state_banner", centreOfLines(view, first, static_cast<int>(lines.size()), small),
            small, ink, basics::joined(lines, "\n"), 1);
  }
}

void ArmMarkers::addMuscles(const Curve& curve, const lie::SE3& X_end, int section,
                            const model::InputRef& pressure, const SideView& view) {
  const model::Arm& arm = scene_.arm;
  const int n = arm.actuatorCount();
  for (int i = arm.firstActuator(section); i < arm.firstActuator(section + 1); ++i) {
    const model::Actuator& actuator = arm.actuator(i);
    const model::Range& limits = actuator.limits;
    std_msgs::ColorRGBA ink =
        pressureColor((pressure[i] - limits.lower) / (limits.upper - limits.lower));
    const double height = kLineHeight * view.scale;
    const double kilopascals = std::round(pressure[i] / 1e3) + 0.0;  // never "-0"
    addText("pressures", centreOfLines(view, view.table_top, n, height), height, ink,
            lineOfColumn(i, n, actuator.name + basics::format("  %.0f kPa", kilopascals)), i);
    ink.a = kMuscleOpacity;
    Marker& tube = add("muscles", Marker::TRIANGLE_LIST, ink, i);
    tube.scale.x = tube.scale.y = tube.scale.z = 1.0;
    addTube(curve, section * kRings, (section + 1) * kRings, X_end, actuator,
            scene_.looks[section].muscle_radius, tube.points);
  }
}

void ArmMarkers::addDiscs(const model::Shape& shape, const lie::SE3& X_end, int section,
                          int& disc) {
  const io::SectionLook& look = scene_.looks[section];
  const model::Actuator& first = scene_.arm.actuator(scene_.arm.firstActuator(section));
  const auto addDisc = [&](const lie::SE3& X, double s, double thickness) {
    Marker& plate = add("separators", Marker::CYLINDER, color(0.75, 0.75, 0.8, 0.55), disc++);
    plate.pose = toPoseMsg(standAlongX(X));
    plate.scale.x = plate.scale.y = 2.0 * look.separator_radius * sizeAt(first, s);
    plate.scale.z = thickness;
  };
  for (int j = 0; j < look.separators; ++j) {
    const double s = static_cast<double>(j) / (look.separators - 1);
    addDisc(model::poseAt(shape, section, s), s, kDisc);
  }
  if (const double plate = scene_.arm.plate(section); plate > 0) {
    addDisc(X_end * lie::SE3{Eigen::Matrix3d::Identity(), {0.5 * plate, 0, 0}}, 1.0, plate);
  }
}

visualization_msgs::MarkerArray ArmMarkers::draw(const model::Shape& shape,
                                                 const model::InputRef& pressure,
                                                 const ros::Time& stamp) {
  if (begin(stamp)) trace_.clear();
  const SideView view = sideViewOf(scene_);
  const int sections = scene_.arm.sectionCount();
  const Curve curve = model::sampleCurve(shape, sections * kRings + 1);
  const Eigen::Vector3d tip = model::tipPose(shape).translation;
  extendTrace(tip);
  for (int k = 0, disc = 0; k < sections; ++k) {
    const lie::SE3 X_end = model::poseAt(shape, k, 1.0);
    addMuscles(curve, X_end, k, pressure, view);
    addDiscs(shape, X_end, k, disc);
  }
  std::vector<Eigen::Vector3d> points;
  for (const auto& point : curve) points.push_back(point.X.translation);
  if (shape.links()) points.push_back(tip);
  addLine("base_curve", Marker::LINE_STRIP, kBaseCurve, addLegend(kModel, view), points);
  if (trace_.size() > 1) {
    addLine("tip_trace", Marker::LINE_STRIP, kBaseCurve, addLegend(kTrace, view, 0.8),
            {trace_.begin(), trace_.end()});
  }
  addWords(view);
  return end();
}

void VisionMarkers::addOutlines(const estimation::TagLayout& layout,
                                const estimation::TwistFit& fit) {
  if (fit.tags.empty()) return;
  Marker& tags = addLine("tags", Marker::LINE_LIST, 0.2 * kMeasuredCurve, color(1, 1, 1), {});
  tags.pose = toPoseMsg(fit.X_B0B);
  const std::vector<lie::SE3> X_BT = estimation::tagPoses(layout, fit.shape);
  const estimation::Corners corners = layout.corners();
  for (const estimation::TagResidual& tag : fit.tags) {
    for (int k = 0; k < 8; ++k) {  // edges from corner to corner
      const Eigen::Vector2d corner = corners.col((k + 1) / 2 % 4);
      tags.points.push_back(toPointMsg(X_BT[tag.tag] * Eigen::Vector3d(corner.x(), corner.y(), 0)));
      tags.colors.push_back(tag.outlier ? color(1.0, 0.25, 0.2) : color(0.47, 0.78, 1.0));
    }
  }
}

visualization_msgs::MarkerArray VisionMarkers::draw(const ros::Time& stamp, const SideView& view,
                                                    const estimation::TagLayout& layout,
                                                    const estimation::TwistFit& fit,
                                                    const model::Shape* model,
                                                    const std::string& text) {
  const Eigen::Vector3d tip = (fit.X_B0B * model::tipPose(fit.shape)).translation;
  begin(stamp);
  const std_msgs::ColorRGBA orange = addLegend(kMeasured, view);
  std_msgs::ColorRGBA pale = orange;  // so that the others show through
  pale.a = 0.5F;
  addLine("measured_curve", Marker::LINE_STRIP, kMeasuredCurve, pale, pointsOf(fit.shape)).pose =
      toPoseMsg(fit.X_B0B);
  if (model != nullptr) {
    std::vector<Eigen::Vector3d> dashes = pointsOf(*model);
    // Dashes are pairs; the tip of a plate or tool is one point more, whose dash begins at the end.
    if (const std::size_t count = dashes.size(); count % 2 == 1) {
      const Eigen::Vector3d end = dashes[count - 2];
      dashes.insert(dashes.end() - 1, end);
    }
    addLine("model_curve", Marker::LINE_LIST, 0.5 * kMeasuredCurve, addLegend(kModelThen, view),
            dashes);
  }
  addOutlines(layout, fit);
  addText("tip_error", tip + view.beyond * (kTipTextOffset * view.scale),
          kTipTextHeight * view.scale, orange, text);
  addEllipsoid("tip_covariance", tip, fit.tip_covariance, pale);
  return end();
}

visualization_msgs::MarkerArray LoopMarkers::draw(const ros::Time& stamp, const SideView& view,
                                                  const Tips& tips) {
  begin(stamp);
  if (tips.wanted) {
    addBall("wanted_tip", *tips.wanted, kWantedSize, addLegend(kWanted, view, 0.7));
  }
  const std_msgs::ColorRGBA cyan = color(0.2, 0.9, 1.0);
  if (!tips.curve.empty()) {
    addLine("predicted_curve", Marker::LINE_STRIP, kPredictedCurve, addLegend(kPredicted, view),
            tips.curve);
  }
  if (!tips.predicted) return end();
  const Eigen::Vector3d tip = *tips.predicted;
  addBall("predicted_tip", tip, kPredictedSize, cyan);
  addEllipsoid("predicted_covariance", tip, tips.covariance, color(0.2, 0.9, 1.0, 0.35));
  const auto write = [&](const char* ns, double to_right, double beyond, double height,
                         const std_msgs::ColorRGBA& ink, const std::string& text) {
    if (text.empty()) return;
    const Eigen::Vector3d offset = to_right * view.right + beyond * view.beyond;
    addText(ns, tip + offset * view.scale, height * view.scale, ink, text);
  };
  write("loop_state", 0, kLoopTextOffset, kLoopTextHeight, cyan, tips.text);
  write("error_budget", kTableOffset, -kTableRise, kTableHeight,
        tips.outside ? color(1.0, 0.5, 0.2) : cyan, tips.budget);
  if (tips.force) {
    const Eigen::Vector3d along = kArrowLength * tips.force->stableNormalized();
    addLine("tip_force", Marker::ARROW, 0.006, color(1.0, 0.2, 0.1), {tip - along, tip}).scale.y =
        0.016;
  }
  return end();
}

TipHandle::TipHandle(const std::string& base_frame, const io::Scene& scene, OnTarget on_target)
    : on_target_(std::move(on_target)), server_(names::kTipHandle) {
  server_.insert(handle(base_frame, scene), [this](const Feedback::ConstPtr& feedback) {
    guard_.run(feedback->client_id, [&] { onFeedback(feedback); });
  });
  server_.applyChanges();
}

bool TipHandle::held() const {
  return pressed_ && ros::SteadyTime::now() - last_feedback_ < ros::WallDuration(kHoldTimeout);
}

void TipHandle::follow(const lie::SE3& X_BT) {
  if (held() || (X_BT.translation - position_).norm() < kFollowStep) return;
  position_ = X_BT.translation;
  server_.setPose(kHandle, toPoseMsg({Eigen::Matrix3d::Identity(), position_}));
  server_.applyChanges();
}

void TipHandle::onFeedback(const visualization_msgs::InteractiveMarkerFeedbackConstPtr& feedback) {
  last_feedback_ = ros::SteadyTime::now();
  if (feedback->event_type == Feedback::MOUSE_DOWN) pressed_ = true;
  if (feedback->event_type == Feedback::MOUSE_UP) pressed_ = false;
  const auto& p = feedback->pose.position;
  position_ = {p.x, p.y, p.z};
  // A handle that is held still sends KEEP_ALIVE; repeating the target then renews the lease.
  const bool wants = feedback->event_type == Feedback::POSE_UPDATE ||
                     (feedback->event_type == Feedback::KEEP_ALIVE && held());
  if (!wants) return;
  TipTarget target;
  target.header = feedback->header;
  target.mode = TipTarget::POSITION;
  target.pose = feedback->pose;
  on_target_(target);
}

}  // namespace helix_arm::ros_bridge
