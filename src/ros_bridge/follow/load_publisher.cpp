#include "ros_bridge/follow/load_publisher.hpp"

#include <algorithm>
#include <limits>
#include <utility>

#include "helix_arm/ErrorBudget.h"
#include "helix_arm/ExternalLoad.h"
#include "helix_arm/procedures/budget_table.hpp"
#include "ros_bridge/common/model_history.hpp"
#include "ros_bridge/common/names.hpp"

namespace helix_arm::ros_bridge {
namespace {

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
  out.header.stamp = picture;
  out.header.frame_id = base_frame_;
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
  out.header.stamp = stamp;
  out.header.frame_id = base_frame_;
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
