#include "ros_bridge/follow/loop_publisher.hpp"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "helix_arm/ArmShape.h"
#include "helix_arm/estimation/twist_fit.hpp"
#include "helix_arm/model/curve.hpp"
#include "helix_arm/procedures/budget_table.hpp"
#include "ros_bridge/common/conversions.hpp"
#include "ros_bridge/common/model_history.hpp"
#include "ros_bridge/common/names.hpp"

namespace helix_arm::ros_bridge {
namespace {

// Readings are not exactly periodic; one slightly early must not be skipped.
constexpr double kSlack = 0.9;
constexpr int kPoints = 24;           // of the drawn curve, a section
constexpr double kFreshBudget = 1.0;  // since its picture [s]

const char* nameOf(statics::InverseStatus status) {
  switch (status) {
    case statics::InverseStatus::kReached:
      return "reached";
    case statics::InverseStatus::kUnreachable:
      return "unreachable";
    case statics::InverseStatus::kNotConverged:
      break;
  }
  return "not_converged";
}

// Covariance of the filter's shape at the present pressures.
Eigen::MatrixXd twistCovariance(const LoopPublisher::View& view) {
  const double elapsed =
      view.last_picture ? std::max(0.0, secondsBetween(*view.last_picture, view.stamp)) : 0.0;
  return view.loop.tracker().twistCovariance(elapsed);
}

double largestDeviation(const Eigen::Matrix3d& covariance) {
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> solver(covariance, Eigen::EigenvaluesOnly);
  return std::sqrt(std::max(0.0, solver.eigenvalues().maxCoeff()));
}

}  // namespace

LoopPublisher::LoopPublisher(ros::NodeHandle& node, const io::Scene& scene,
                             const VisualServoOptions& options, std::string base_frame,
                             TipHandle::OnTarget on_target)
    : scene_(scene),
      base_frame_(std::move(base_frame)),
      period_(kSlack / options.rate),
      markers_(base_frame_, std::max(1.0, 3.0 / options.draw_rate)),
      status_publisher_(node.advertise<LoopStatus>(names::kVisualServoStatus, 10)),
      estimate_publisher_(node.advertise<ArmShape>(names::kEstimate, 10)),
      marker_publisher_(node.advertise<visualization_msgs::MarkerArray>(names::kLoopMarkers, 2)) {
  if (options.handle) {
    const double size = std::clamp(4.0 * scene.looks.back().separator_radius, 0.1, 0.15);
    handle_ = std::make_unique<TipHandle>(base_frame_, scene.planar.has_value(), size,
                                          std::move(on_target));
  }
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
  std_msgs::Header header;
  header.stamp = view.stamp;
  header.frame_id = base_frame_;
  estimate_publisher_.publish(toShapeMsg(header, "estimated", *shape, twistCovariance(view)));
}

LoopStatus LoopPublisher::statusOf(const View& view, const Eigen::Matrix3d& tip_covariance) const {
  const follow::Turn& turn = view.loop.turn();
  LoopStatus out;
  out.header.stamp = view.stamp;
  out.header.frame_id = base_frame_;
  out.state = follow::nameOf(turn.state);
  out.message = view.message;
  out.commander = view.commander;
  out.path_time = std::numeric_limits<double>::quiet_NaN();
  out.has_wanted = turn.commands;
  if (turn.commands) {
    out.wanted = toPoseMsg(turn.wanted);
    out.inverse = nameOf(turn.status);
    out.residual = turn.residual;
    for (int i = 0; i < scene_.arm.actuatorCount(); ++i) {
      const statics::Limit limit = turn.limits[static_cast<std::size_t>(i)];
      const std::string& name = scene_.arm.actuator(i).name;
      if (limit == statics::Limit::kLower) out.at_lower_limit.push_back(name);
      if (limit == statics::Limit::kUpper) out.at_upper_limit.push_back(name);
    }
    if (turn.path_time) out.path_time = *turn.path_time;
  }
  out.has_predicted = turn.predicted.has_value();
  if (turn.predicted) {
    out.predicted = toPoseMsg(*turn.predicted);
    out.predicted_covariance = toCovarianceMsg(tip_covariance);
    out.predicted_sd = largestDeviation(tip_covariance);
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

}  // namespace helix_arm::ros_bridge
