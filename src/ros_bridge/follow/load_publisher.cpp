#include "helix_arm/ros_bridge/follow/load_publisher.hpp"

#include <algorithm>
#include <limits>
#include <utility>

#include "helix_arm/ErrorBudget.h"
#include "helix_arm/ExternalLoad.h"
#include "helix_arm/ros_bridge/common/model_history.hpp"
#include "helix_arm/ros_bridge/common/names.hpp"

namespace helix_arm::ros_bridge {
namespace {

constexpr double kBudgetPeriod = 0.2;  // [s]

geometry_msgs::Vector3 toVectorMsg(const Eigen::Vector3d& vector) {
  geometry_msgs::Vector3 out;
  out.x = vector.x();
  out.y = vector.y();
  out.z = vector.z();
  return out;
}

}  // namespace

LoadPublisher::LoadPublisher(ros::NodeHandle& node, std::string base_frame)
    : base_frame_(std::move(base_frame)),
      budget_publisher_(node.advertise<ErrorBudget>(names::kErrorBudget, 10)),
      load_publisher_(node.advertise<ExternalLoad>(names::kExternalLoad, 10, true)) {}

void LoadPublisher::publish(const ros::Time& picture, const follow::SightLoop& loop) {
  const double since = secondsBetween(last_budget_, picture);
  // During contact the budget is that of an earlier picture.
  const bool present = loop.budget() && loop.budget()->time == picture.toSec();
  if (present && (since < 0 || since >= kBudgetPeriod)) {
    publishBudget(picture, *loop.budget());
  }
  publishLoad(picture, loop);
}

void LoadPublisher::publishBudget(const ros::Time& picture,
                                  const estimation::TipErrorBudget& budget) {
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
  if (budget.state == estimation::BudgetState::kOutside) {
    out.message =
        "the calibration does not explain this: a load, slip or a changed muscle; check the arm, "
        "then calibrate again";
  }
  budget_publisher_.publish(out);
}

void LoadPublisher::publishLoad(const ros::Time& picture, const follow::SightLoop& loop) {
  const estimation::ExternalLoad& load = loop.load();
  const bool outside = loop.budget() && loop.budget()->state == estimation::BudgetState::kOutside;
  ExternalLoad out;
  out.state = load.contact ? ExternalLoad::CONTACT
              : outside    ? ExternalLoad::OUTSIDE_BUDGET
                           : ExternalLoad::NONE;
  if (!load.contact && out.state == last_state_) return;
  last_state_ = out.state;
  out.header.stamp = picture;
  out.header.frame_id = base_frame_;
  out.score = load.score;
  out.limit = loop.contactLimit();
  out.s = std::numeric_limits<double>::quiet_NaN();
  out.normalised = load.normalised;
  if (load.contact) {
    out.onset = ros::Time(load.onset);
    if (load.place) {
      out.section = load.place->section + 1;
      out.s = load.place->s;
    }
    out.force = toVectorMsg(load.force);
    out.covariance = toCovarianceMsg(load.covariance);
    out.determined.assign(load.determined.data(), load.determined.data() + load.determined.size());
    out.message = "contact with the arm; clear it, or accept the load (on_contact: report)";
  } else if (outside) {
    out.message =
        "the calibration does not explain the arm's shape: a load, slip or a changed muscle";
  }
  load_publisher_.publish(out);
}

}  // namespace helix_arm::ros_bridge
