#include "shape_publisher.hpp"

#include <array>
#include <cctype>
#include <cmath>
#include <cstdio>
#include <sstream>

#include "helix_arm/model/curve.hpp"
#include "ros_bridge/common/conversions.hpp"
#include "ros_bridge/common/log.hpp"
#include "ros_bridge/common/model_history.hpp"
#include "ros_bridge/names.hpp"

namespace helix_arm::ros_bridge {
namespace {

using visualization_msgs::Marker;
using Curve = std::vector<model::CurvePoint<lie::SE3>>;

constexpr int kRings = 24;               // of a tube, per section
constexpr int kSides = 10;               // of a tube
constexpr double kDisc = 0.004;          // thickness of a separator [m]
constexpr double kLine = 0.003;          // width of the base curve [m]
constexpr float kMuscleOpacity = 0.45F;  // the curves inside the arm show through
// Of letters, for an arm of 0.3 m: see SideView::scale.
constexpr double kBannerHeight = 0.022;  // [m]
constexpr double kReasonHeight = 0.012;  // [m]
constexpr double kLineHeight = 0.016;    // [m]
// Of the state's reason. The cockpit shows all of it.
constexpr std::size_t kLongestLine = 78;  // in characters
constexpr int kMostLines = 4;
constexpr std::size_t kTraceLength = 400;
constexpr double kTraceStep = 0.002;     // between points of the trace [m]
constexpr double kTraceSmoothing = 0.3;  // weight of a new tip; a larger one makes the trace noisy

// Blue to lilac: bright enough for text on a dark background, and unlike the colours of the curves
// (legendLine), which show through the muscles.
std_msgs::ColorRGBA pressureColor(double share) {
  constexpr std::array<std::array<double, 3>, 4> kStops = {
      {{0.4, 0.65, 1.0}, {0.6, 0.6, 1.0}, {0.8, 0.62, 1.0}, {1.0, 0.8, 1.0}}};
  const double place = 3.0 * std::clamp(share, 0.0, 1.0);
  const int k = std::min(2, static_cast<int>(place));
  const double t = place - k;
  const auto mix = [&](int i) { return kStops[k][i] + t * (kStops[k + 1][i] - kStops[k][i]); };
  return color(mix(0), mix(1), mix(2));
}

// Points of the circle around a muscle, in the y-z plane of its frame, whose x axis runs along the
// muscle.
Eigen::Vector3d onCircle(double radius, int side) {
  const double angle = 6.283185307179586 * side / kSides;
  return {0.0, radius * std::cos(angle), radius * std::sin(angle)};
}

// Triangles of the tube of a muscle along the curve, between two points of the curve.
// The second one is at X_last, since the curve continues there beyond a plate.
void addTube(const Curve& curve, int first, int last, const lie::SE3& X_last,
             const model::Actuator& actuator, double radius,
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

std::string pressureText(const std::string& name, double pressure) {
  char value[32];
  const double kilopascals = std::round(pressure / 1e3) + 0.0;  // never "-0"
  std::snprintf(value, sizeof value, "  %.0f kPa", kilopascals);
  return name + value;
}

// Name of an arm whose frames have a prefix, as in a namespace; otherwise empty.
std::string nameOf(const std::string& base_frame) {
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
std::vector<std::string> wrapped(const std::string& text) {
  const std::size_t cut = text.find(": ");
  std::istringstream words(cut == std::string::npos ? text : text.substr(cut + 2));
  std::vector<std::string> out;
  for (std::string word; words >> word;) {
    if (out.empty() || out.back().size() + word.size() >= kLongestLine) {
      if (out.size() == kMostLines) {
        out.back() += " ...";
        break;
      }
      out.push_back(word);
    } else {
      out.back() += " " + word;
    }
  }
  return out;
}

std_msgs::ColorRGBA stateColor(const control::SafetyReport& report) {
  if (report.stopped || report.vent_overdue) return color(1.0, 0.3, 0.25);
  switch (report.state) {
    case control::SafetyState::kEnabled:
      return color(0.4, 1.0, 0.5);
    case control::SafetyState::kFault:
      return color(1.0, 0.3, 0.25);
    case control::SafetyState::kVented:
      return color(1.0, 0.75, 0.3);
    case control::SafetyState::kDisabled:
      break;
  }
  return color(0.8, 0.8, 0.85);
}

using diagnostic_msgs::DiagnosticStatus;

constexpr double kFresh = 1.0;  // a longer silence of the regulator is an error [s]

}  // namespace

void ArmMarkers::extendTrace(const Eigen::Vector3d& tip) {
  if (trace_.empty()) smooth_tip_ = tip;
  smooth_tip_ += kTraceSmoothing * (tip - smooth_tip_);
  if (!trace_.empty() && (smooth_tip_ - trace_.back()).norm() < kTraceStep) return;
  trace_.push_back(smooth_tip_);
  if (trace_.size() > kTraceLength) trace_.pop_front();
}

void ArmMarkers::addWords(const SideView& view, visualization_msgs::MarkerArray& out) const {
  Marker banner = marker_(stamp_, names::kStateBannerNs, Marker::TEXT_VIEW_FACING);
  banner.scale.z = kBannerHeight * view.scale;
  banner.color = stateColor(safety_);
  banner.text = nameOf(marker_.frame) + stateText(safety_);
  banner.pose.position = toPointMsg(view.headline);
  const std::vector<std::string> lines = wrapped(reason_);
  if (!lines.empty()) {
    Marker reason = banner;
    reason.id = 1;
    reason.scale.z = kReasonHeight * view.scale;
    reason.text = lines.front();
    for (std::size_t i = 1; i < lines.size(); ++i) reason.text += "\n" + lines[i];
    // The first line stays below the state, however many follow.
    const Eigen::Vector3d first = view.headline - kBannerHeight * view.scale * view.up;
    reason.pose.position =
        toPointMsg(centreOfLines(view, first, static_cast<int>(lines.size()), reason.scale.z));
    out.markers.push_back(std::move(reason));
  }
  out.markers.push_back(std::move(banner));
  for (const LegendLine line : {LegendLine::kModel, LegendLine::kTrace}) {
    if (line == LegendLine::kTrace && trace_.size() < 2) continue;
    out.markers.push_back(
        legendLine(line, view, marker_(stamp_, names::kLegendNs, Marker::TEXT_VIEW_FACING)));
  }
}

void ArmMarkers::addMuscles(const Curve& curve, const lie::SE3& X_end, int section,
                            const model::InputRef& pressure, const SideView& view,
                            visualization_msgs::MarkerArray& out) const {
  const model::Arm& arm = scene_.arm;
  for (int i = arm.firstActuator(section); i < arm.firstActuator(section + 1); ++i) {
    const model::Actuator& actuator = arm.actuator(i);
    const model::Range& limits = actuator.limits;
    Marker tube = marker_(stamp_, names::kMusclesNs, Marker::TRIANGLE_LIST, i);
    tube.scale.x = tube.scale.y = tube.scale.z = 1.0;
    tube.color = pressureColor((pressure[i] - limits.lower) / (limits.upper - limits.lower));
    addTube(curve, section * kRings, (section + 1) * kRings, X_end, actuator,
            scene_.looks[section].muscle_radius, tube.points);

    Marker text = marker_(stamp_, names::kPressuresNs, Marker::TEXT_VIEW_FACING, i);
    text.scale.z = kLineHeight * view.scale;
    text.color = tube.color;
    text.text = lineOfColumn(i, arm.actuatorCount(), pressureText(actuator.name, pressure[i]));
    text.pose.position =
        toPointMsg(centreOfLines(view, view.table_top, arm.actuatorCount(), text.scale.z));
    tube.color.a = kMuscleOpacity;
    out.markers.push_back(std::move(tube));
    out.markers.push_back(std::move(text));
  }
}

void ArmMarkers::addDiscs(const model::Shape& shape, const lie::SE3& X_end, int section, int& disc,
                          visualization_msgs::MarkerArray& out) const {
  const io::SectionLook& look = scene_.looks[section];
  const model::Actuator& first = scene_.arm.actuator(scene_.arm.firstActuator(section));
  const auto addDisc = [&](const lie::SE3& X, double s, double thickness) {
    Marker plate = marker_(stamp_, names::kSeparatorsNs, Marker::CYLINDER, disc++);
    plate.pose = toPoseMsg(standAlongX(X));
    plate.scale.x = plate.scale.y = 2.0 * look.separator_radius * sizeAt(first, s);
    plate.scale.z = thickness;
    plate.color = color(0.75, 0.75, 0.8, 0.55);
    out.markers.push_back(std::move(plate));
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
  if (stamp < stamp_) trace_.clear();
  stamp_ = stamp;
  const SideView view = sideViewOf(scene_);
  const int sections = scene_.arm.sectionCount();
  const Curve curve = model::sampleCurve(shape, sections * kRings + 1);
  const Eigen::Vector3d tip = model::tipPose(shape).translation;
  extendTrace(tip);

  visualization_msgs::MarkerArray out;
  for (int k = 0, disc = 0; k < sections; ++k) {
    const lie::SE3 X_end = model::poseAt(shape, k, 1.0);
    addMuscles(curve, X_end, k, pressure, view, out);
    addDiscs(shape, X_end, k, disc, out);
  }
  const auto addLine = [&](const char* ns, const std_msgs::ColorRGBA& color) -> auto& {
    Marker& line = out.markers.emplace_back(marker_(stamp_, ns, Marker::LINE_STRIP));
    line.scale.x = kLine;
    line.color = color;
    return line.points;
  };
  auto& points = addLine(names::kBaseCurveNs, color(1.0, 1.0, 1.0));
  for (const auto& point : curve) points.push_back(toPointMsg(point.X.translation));
  if (shape.links()) points.push_back(toPointMsg(tip));
  if (trace_.size() > 1) {
    auto& traced = addLine(names::kTipTraceNs, color(0.4, 1.0, 0.6, 0.8));
    for (const auto& point : trace_) traced.push_back(toPointMsg(point));
  }
  addWords(view, out);
  drawn_.clear();
  for (const Marker& drawn : out.markers) drawn_.emplace_back(drawn.ns, drawn.id);
  return out;
}

visualization_msgs::MarkerArray ArmMarkers::remove(const ros::Time& stamp) {
  stamp_ = stamp;
  trace_.clear();
  visualization_msgs::MarkerArray out;
  for (const auto& [ns, id] : drawn_) {
    out.markers.push_back(marker_(stamp_, ns.c_str(), Marker::SPHERE, id));
    out.markers.back().action = Marker::DELETE;
  }
  drawn_.clear();
  return out;
}

ShapePublisher::ShapePublisher(ros::NodeHandle node, const io::Scene& scene,
                               const PressureCommandOptions& options, TipHandle::OnTarget on_target)
    : scene_(scene),
      frames_(options.world_frame, options.frame_prefix, names::kModelFrames, options.frames),
      readings_per_tf_(static_cast<std::uint64_t>(std::lround(options.rate / options.tf_rate))),
      own_regulator_(options.regulator == "scene"),
      markers_(scene, frames_.base, std::max(1.0, 3.0 / options.draw_rate)),
      measured_(scene.arm.inputAt(0)),
      response_(scene.arm),
      solution_(scene.model.solve(measured_)),
      model_publisher_(node.advertise<ArmShape>(names::kModel, 10)),
      marker_publisher_(node.advertise<visualization_msgs::MarkerArray>(names::kMarkers, 2)) {
  sendBaseFrame();
  if (options.handle) {
    handle_ = std::make_unique<TipHandle>(frames_.base, scene, std::move(on_target));
  }
}

void ShapePublisher::solve() {
  const bool rests = last_reading_.isZero();  // before the first reading
  const Eigen::VectorXd pressure = scene_.arm.clamped(rests ? measured_ : response_.effective());
  solution_ = scene_.model.solve(pressure);
  if (solution_.converged() || !unsolved_.add()) return;
  std::ostringstream at;
  at << (1e-3 * pressure).transpose();
  logWarning(
      "%s: the %s model finds no shape that balances the load at %s kPa (%s, residual %.2g; %lu "
      "times "
      "so far): no model is published there; check the scene's load and arm.stiffness.K_eps_n",
      scene_.name.c_str(), scene_.model.choice().setting.name().c_str(), at.str().c_str(),
      statics::nameOf(solution_.status), solution_.residual, unsolved_.total());
}

void ShapePublisher::take(const Eigen::VectorXd& measured, const ros::Time& stamp) {
  measured_ = measured;
  const ros::Time at = stamp.isZero() ? ros::Time::now() : stamp;
  if (response_.follow(at.toSec(), measured) && !response_.instant() && restarts_.add()) {
    logWarning(
        "pressure_measured is stamped earlier than the reading before (%lu times so far): the "
        "actuators' responses start anew, and their memory is unknown until the pressures have "
        "moved by twice the largest play_kpa",
        restarts_.total());
  }
  last_reading_ = ros::SteadyTime::now();
  solve();
  ++readings_;
  if (!solution_.converged()) return;
  const std_msgs::Header header = toHeaderMsg(stamp, frames_.base);
  model_publisher_.publish(toShapeMsg(header, scene_.model.choice(), solution_.shape));
  if (readings_ % readings_per_tf_ == 0) curve_frames_.send(solution_.shape, stamp);
}

bool ShapePublisher::measures() const {
  return !last_reading_.isZero() &&
         ros::SteadyTime::now() - last_reading_ < ros::WallDuration(kFresh);
}

void ShapePublisher::draw() {
  if (!measures() || !solution_.converged()) {
    if (drawn_) {
      marker_publisher_.publish(markers_.remove(ros::Time::now()));
      if (!measures() && losses_.add()) {
        logWarning(
            "no pressures were measured for %g s (%lu times so far): %s; the arm is not drawn "
            "until "
            "they are",
            kFresh, losses_.total(), unmeasuredText().c_str());
      }
    }
    drawn_ = false;
    return;
  }
  drawn_ = true;
  marker_publisher_.publish(markers_.draw(solution_.shape, measured_, ros::Time::now()));
}

DiagnosticStatus ShapePublisher::status() const {
  const statics::TierChoice& choice = scene_.model.choice();
  const bool solved = solution_.converged();
  DiagnosticStatus out =
      makeStatus(names::kModelStatus, solved ? DiagnosticStatus::OK : DiagnosticStatus::ERROR,
                 solved ? "the model finds the arm's shape"
                        : "the model finds no shape that balances the load: none is published; "
                          "check the scene's load and arm.stiffness.K_eps_n",
                 {{names::kTierKey, statics::nameOf(choice.setting.tier)},
                  {"order", std::to_string(choice.setting.order)},
                  {"tier_reason", choice.reason},
                  {names::kSolveStatusKey, statics::nameOf(solution_.status)},
                  {names::kUnsolvedKey, std::to_string(unsolved_.total())}});
  if (response_.instant()) return out;
  addValue(out, "memory_known", response_.known() ? "true" : "false");
  addValue(out, "effective_uncertainty_kpa", fixed(1e-3 * response_.uncertainty().maxCoeff()));
  return out;
}

void ShapePublisher::reportSilence(DiagnosticStatus& status) const {
  if (measures()) return;
  const bool never = last_reading_.isZero();
  status.level = never ? DiagnosticStatus::WARN : DiagnosticStatus::ERROR;
  status.message = never ? "waits for the first pressure_measured" : unmeasuredText();
}

}  // namespace helix_arm::ros_bridge
