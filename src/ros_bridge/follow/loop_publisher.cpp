#include "loop_publisher.hpp"

#include <Eigen/Eigenvalues>
#include <cmath>
#include <limits>

#include "helix_arm/ErrorBudget.h"
#include "helix_arm/ExternalLoad.h"
#include "helix_arm/localization/twist_fit.hpp"
#include "helix_arm/model/curve.hpp"
#include "helix_arm/procedures/budget_table.hpp"
#include "ros_bridge/common/conversions.hpp"
#include "ros_bridge/common/model_history.hpp"
#include "ros_bridge/names.hpp"

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

// Readings are not exactly periodic; one slightly early must not be skipped.
constexpr double kSlack = 0.9;
constexpr int kPoints = 24;           // of the drawn curve, a section
constexpr double kFreshBudget = 1.0;  // since its picture [s]

// Covariance of the filter's shape at the present pressures.
Eigen::MatrixXd twistCovariance(const LoopPublisher::View& view) {
  const double elapsed =
      view.last_picture ? std::max(0.0, secondsBetween(*view.last_picture, view.stamp)) : 0.0;
  return view.loop.tracker().twistCovariance(elapsed);
}

constexpr double kBudgetPeriod = 0.2;  // [s]
constexpr char kUnexplained[] =
    "the calibration does not explain the arm's shape: a load, slip, a changed muscle, or a camera "
    "that has moved";

geometry_msgs::Vector3 toVectorMsg(const Eigen::Vector3d& vector) {
  geometry_msgs::Vector3 out;
  out.x = vector.x();
  out.y = vector.y();
  out.z = vector.z();
  return out;
}

const std::string& stateOf(const follow::VisualServo& loop) {
  if (!loop.sees()) return ExternalLoad::UNSEEN;
  if (loop.load().contact) return ExternalLoad::CONTACT;
  const bool outside = loop.budget() && loop.budget()->state == estimation::BudgetState::kOutside;
  return outside ? ExternalLoad::OUTSIDE_BUDGET : ExternalLoad::NONE;
}

}  // namespace

void LoopMarkers::addLegend(const ros::Time& stamp, const SideView& view, LegendLine line,
                            bool drawn, visualization_msgs::MarkerArray& out) const {
  out.markers.push_back(
      legendLine(line, view, marker_(stamp, names::kLegendNs, Marker::TEXT_VIEW_FACING)));
  if (!drawn) out.markers.back().action = Marker::DELETE;
}

Marker LoopMarkers::ball(const ros::Time& stamp, const char* ns,
                         const std::optional<Eigen::Vector3d>& centre, double size) const {
  Marker out = marker_(stamp, ns, Marker::SPHERE);
  if (!centre) {
    out.action = Marker::DELETE;
    return out;
  }
  out.pose.position = toPointMsg(*centre);
  out.scale.x = out.scale.y = out.scale.z = size;
  return out;
}

Marker LoopMarkers::arrow(const ros::Time& stamp, const Tips& tips) const {
  Marker out = marker_(stamp, names::kTipForceNs, Marker::ARROW);
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
  Marker out = marker_(stamp, "predicted_curve", Marker::LINE_STRIP);
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
  Marker out = marker_(stamp, ns, Marker::TEXT_VIEW_FACING);
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

LoopPublisher::LoopPublisher(ros::NodeHandle& node, const io::Scene& scene, std::string base_frame,
                             double rate, double draw_rate, TipHandle::OnTarget on_target)
    : scene_(scene),
      base_frame_(std::move(base_frame)),
      period_(kSlack / rate),
      markers_(base_frame_, std::max(1.0, 3.0 / draw_rate)),
      status_publisher_(node.advertise<LoopStatus>(names::kVisualServoStatus, 10)),
      estimate_publisher_(node.advertise<ArmShape>(names::kEstimate, 10)),
      marker_publisher_(node.advertise<visualization_msgs::MarkerArray>(names::kLoopMarkers, 2)) {
  if (on_target) handle_ = std::make_unique<TipHandle>(base_frame_, scene, std::move(on_target));
}

bool LoopPublisher::isDue(const View& view) const {
  const double since = secondsBetween(status_.header.stamp, view.stamp);
  return since < 0 || since >= period_ || status_.state != follow::nameOf(view.loop.state());
}

Eigen::Matrix3d LoopPublisher::tipCovariance(const View& view) {
  const auto& tracker = view.loop.tracker();
  const auto shape = tracker.shape(view.loop.observer().newest().pressure);
  if (!shape) return Eigen::Matrix3d::Zero();
  return estimation::tipCovariance(*shape, twistCovariance(view));
}

void LoopPublisher::publish(const View& view) {
  const estimation::ExternalLoad& load = view.loop.load();
  const bool touched = load.contact && view.loop.sees();
  force_ = touched ? std::optional(load.force) : std::nullopt;
  force_text_.clear();
  if (touched) {
    force_text_ = load.normalised ? "contact" : "contact, " + fixed(load.force.norm(), 2) + " N";
  }
  if (!isDue(view)) return;
  noteBudget(view);
  publishEstimate(view);
  status_ = statusOf(view, tipCovariance(view));
  status_publisher_.publish(status_);
}

void LoopPublisher::clear() {
  status_ = {};
  force_.reset();
  force_text_.clear();
  curve_.clear();
  budget_text_.clear();
}

void LoopPublisher::noteBudget(const View& view) {
  const auto& budget = view.loop.budget();
  const bool fresh =
      view.last_picture && std::abs(secondsBetween(*view.last_picture, view.stamp)) < kFreshBudget;
  budget_text_ = budget && fresh ? procedures::budgetText(*budget) : std::string();
  outside_ = budget && budget->state == estimation::BudgetState::kOutside;
}

void LoopPublisher::publishEstimate(const View& view) {
  const auto shape = view.loop.tracker().shape(view.loop.observer().newest().pressure);
  if (!shape) return;
  curve_.clear();
  for (const auto& point : model::sampleToTip(*shape, shape->sectionCount() * kPoints)) {
    curve_.push_back(point.X.translation);
  }
  const std_msgs::Header header = toHeaderMsg(view.stamp, base_frame_);
  estimate_publisher_.publish(toShapeMsg(header, "estimated", *shape, twistCovariance(view)));
}

LoopStatus LoopPublisher::statusOf(const View& view, const Eigen::Matrix3d& tip_covariance) const {
  const follow::Turn& turn = view.loop.turn();
  LoopStatus out;
  out.header = toHeaderMsg(view.stamp, base_frame_);
  out.state = follow::nameOf(turn.state);
  out.message = view.message;
  out.commander = view.commander;
  out.path_time = std::numeric_limits<double>::quiet_NaN();
  out.has_wanted = turn.commands;
  if (turn.commands) {
    out.wanted = toPoseMsg(turn.wanted);
    out.inverse = inverseWord(turn.status);
    out.residual = turn.residual;
    out.at_lower_limit = namesAt(statics::Limit::kLower, scene_.arm, turn.limits);
    out.at_upper_limit = namesAt(statics::Limit::kUpper, scene_.arm, turn.limits);
    if (turn.path_time) out.path_time = *turn.path_time;
  }
  out.has_predicted = turn.predicted.has_value();
  if (turn.predicted) {
    out.predicted = toPoseMsg(*turn.predicted);
    out.predicted_covariance = toCovarianceMsg(tip_covariance);
    out.predicted_sd = estimation::TipSpread{tip_covariance}.deviation();
  }
  out.error = view.loop.error().value_or(std::numeric_limits<double>::quiet_NaN());
  out.accepted = view.pictures.accepted();
  out.refused = view.pictures.refused();
  return out;
}

void LoopPublisher::draw() {
  const auto positionOf = [](bool has, const geometry_msgs::Pose& pose) {
    return has ? std::optional<Eigen::Vector3d>(fromMsg(pose).translation) : std::nullopt;
  };
  LoopMarkers::Tips tips;
  tips.wanted = positionOf(status_.has_wanted, status_.wanted);
  tips.predicted = positionOf(status_.has_predicted, status_.predicted);
  tips.covariance = Eigen::Map<const Eigen::Matrix3d>(status_.predicted_covariance.data());
  if (status_.has_predicted) tips.curve = curve_;
  tips.text = status_.state;
  tips.force = force_;
  tips.budget = budget_text_;
  tips.outside = outside_;
  if (std::isfinite(status_.error)) tips.text += ", " + fixed(1e3 * status_.error, 2) + " mm";
  if (!force_text_.empty()) tips.text += "\n" + force_text_;
  marker_publisher_.publish(markers_.draw(ros::Time::now(), sideViewOf(scene_), tips));
  if (!handle_) return;
  if (const auto& at = tips.wanted ? tips.wanted : tips.predicted) {
    handle_->follow({Eigen::Matrix3d::Identity(), *at});
  }
}

LoadPublisher::LoadPublisher(ros::NodeHandle& node, std::string base_frame)
    : base_frame_(std::move(base_frame)),
      budget_publisher_(node.advertise<ErrorBudget>(names::kErrorBudget, 10)),
      load_publisher_(node.advertise<ExternalLoad>(names::kExternalLoad, 10, true)) {}

void LoadPublisher::publish(const ros::Time& picture, const follow::VisualServo& loop) {
  const double since = secondsBetween(last_budget_, picture);
  // During a contact that is not doubted the budget is that of an earlier picture.
  const bool present = loop.budget() && loop.budget()->time == picture.toSec();
  if (present && (since < 0 || since >= kBudgetPeriod)) {
    publishBudget(picture, *loop.budget(), loop.drift());
  }
  publishLoad(picture, loop);
}

void LoadPublisher::publishBudget(const ros::Time& picture,
                                  const estimation::TipErrorBudget& budget,
                                  const estimation::Drift& drift) {
  last_budget_ = picture;
  ErrorBudget out;
  out.header = toHeaderMsg(picture, base_frame_);
  for (int i = 0; i < estimation::kBudgetPartCount; ++i) {
    const auto part = static_cast<estimation::BudgetPart>(i);
    const estimation::TipSpread& spread = budget.part(part);
    out.names.emplace_back(nameOf(part));
    out.covariance.insert(out.covariance.end(), spread.covariance.data(),
                          spread.covariance.data() + 9);
    out.sd.push_back(spread.deviation());
  }
  out.predicted = toCovarianceMsg(budget.predicted.covariance);
  out.predicted_sd = budget.predicted.deviation();
  out.open_loop = toCovarianceMsg(budget.open_loop.covariance);
  out.open_loop_sd = budget.open_loop.deviation();
  out.error = toVectorMsg(budget.error);
  out.distance2 = budget.distance2;
  out.limit = budget.limit;
  out.state = nameOf(budget.state);
  if (drift.doubtful) {
    out.message = procedures::driftText(drift);
  } else if (budget.state == estimation::BudgetState::kOutside) {
    out.message = std::string(kUnexplained) + "; check the arm, then calibrate again";
  }
  budget_publisher_.publish(out);
}

void LoadPublisher::publishChange(const ros::Time& turn, const follow::VisualServo& loop) {
  if (!last_state_.empty() && stateOf(loop) != last_state_) publishLoad(turn, loop);
}

void LoadPublisher::publishLoad(const ros::Time& stamp, const follow::VisualServo& loop) {
  const std::string& state = stateOf(loop);
  const bool touched = state == ExternalLoad::CONTACT;
  if (!touched && state == last_state_) return;
  last_state_ = state;
  const estimation::ExternalLoad& load = loop.load();
  ExternalLoad out;
  out.state = state;
  out.header = toHeaderMsg(stamp, base_frame_);
  if (state != ExternalLoad::UNSEEN) out.score = load.score;
  out.limit = loop.contactLimit();
  out.s = std::numeric_limits<double>::quiet_NaN();
  out.normalised = load.normalised;
  if (touched) {
    out.onset = ros::Time(load.onset);
    if (load.place) {
      out.section = load.place->section + 1;
      out.s = load.place->s;
    }
    out.force = toVectorMsg(load.force);
    out.covariance = toCovarianceMsg(load.covariance);
    out.determined.assign(load.determined.data(), load.determined.data() + load.determined.size());
    out.message = "contact with the arm; clear it, or accept the load (on_contact: report)";
  } else if (state == ExternalLoad::OUTSIDE_BUDGET) {
    out.message = loop.drift().doubtful ? procedures::driftText(loop.drift()) : kUnexplained;
  } else if (state == ExternalLoad::UNSEEN) {
    out.message =
        "the arm is not seen, so what acts on it is not known; check the camera (vision_status)";
  }
  load_publisher_.publish(out);
}

}  // namespace helix_arm::ros_bridge
