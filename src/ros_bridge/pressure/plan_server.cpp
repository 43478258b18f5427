#include "plan_server.hpp"

#include <utility>

#include "basics/quote.hpp"
#include "helix_arm/basics/requirement.hpp"
#include "helix_arm/control/target_check.hpp"
#include "ros_bridge/common/conversions.hpp"
#include "ros_bridge/names.hpp"

namespace helix_arm::ros_bridge {
namespace {

constexpr double kLongestSearch = 60.0;  // [s]
constexpr double kEveryFeedback = 0.1;   // [s]

// (n) pressures of a goal within the limits. @throws std::invalid_argument naming the culprit.
Eigen::VectorXd pressuresOf(const model::Arm& arm, const std::vector<double>& pressure) {
  return orThrow(control::checkPressures(arm, arm.inputAt(0.0), {}, pressure));
}

}  // namespace

PlanServer::PlanServer(const ros::NodeHandle& private_node, const io::Scene& scene,
                       const std::string& base_frame, const PressureLoop& loop)
    : base_frame_(base_frame),
      loop_(loop),
      server_(
          private_node, names::kPlanTipPath,
          [this](const PlanTipPathGoalConstPtr& goal) { guard_.run("", [&] { onGoal(*goal); }); },
          false) {
  adopt(scene);
  server_.start();
}

PlanServer::~PlanServer() { server_.shutdown(); }

void PlanServer::adopt(const io::Scene& scene) {
  std::shared_ptr<const Rig> next;
  if (scene.keep_out) {
    next = std::make_shared<const Rig>(
        Rig{scene.model, planning::PressurePlanner(scene.model, *scene.keep_out,
                                                   scene.safety.channels, scene.safety.rules)});
  }
  const basics::MutexLock lock(mutex_);
  rig_ = std::move(next);
}

void PlanServer::onGoal(const PlanTipPathGoal& goal) {
  PlanTipPathResult result;
  try {
    result = plan(goal);
  } catch (const std::exception& fault) {
    result.message = basics::printableLines(fault.what());
  }
  if (server_.isPreemptRequested()) {
    server_.setPreempted(result, "cancelled");
  } else if (result.found) {
    server_.setSucceeded(result, "");
  } else {
    server_.setAborted(result, result.message);
  }
}

PlanTipPathResult PlanServer::plan(const PlanTipPathGoal& goal) {
  basics::MutexLock lock(mutex_);
  const auto rig = rig_;
  lock.unlock();
  basics::require(rig != nullptr, "the scene has no zones to plan around; add the key keep_out");
  const planning::Plan found = search(*rig, goal);
  PlanTipPathResult result;
  result.found = found.found();
  result.message = found.reason;
  result.seconds = found.seconds;
  if (!found.found()) return result;
  result.path.header.frame_id = base_frame_;
  for (const planning::PlanRow& row : found.rows) {
    result.pressure.insert(result.pressure.end(), row.pressure.begin(), row.pressure.end());
    trajectory_msgs::MultiDOFJointTrajectoryPoint point;
    point.transforms.push_back(toTransformMsg(row.tip));
    point.time_from_start = ros::Duration(row.time);
    result.path.points.push_back(point);
  }
  result.rows = static_cast<std::uint32_t>(found.rows.size());
  const clearance::Clearance& least = found.nearest().clearance;
  result.clearance = least.distance;
  result.zone = rig->planner.check().clearance().nameOf(least.zone);
  return result;
}

planning::Plan PlanServer::search(const Rig& rig, const PlanTipPathGoal& goal) {
  basics::require(goal.longest_s >= 0 && goal.longest_s <= kLongestSearch, "longest_s is ",
                  goal.longest_s, "; expected 0 to ", kLongestSearch);
  planning::PlanOptions options;
  if (goal.longest_s > 0) options.longest = goal.longest_s;
  told_ = -kEveryFeedback;
  options.stops = [this](const planning::PlanProgress& progress) {
    if (progress.seconds - told_ >= kEveryFeedback) {
      told_ = progress.seconds;
      PlanTipPathFeedback feedback;
      feedback.phase = progress.phase;
      feedback.seconds = progress.seconds;
      server_.publishFeedback(feedback);
    }
    return server_.isPreemptRequested() || !ros::ok();
  };
  const model::Arm& arm = rig.model.arm();
  const Eigen::VectorXd from = goal.start.empty() ? loop_.goal() : pressuresOf(arm, goal.start);
  if (!goal.pressure.empty()) {
    return rig.planner.toPressures(from, pressuresOf(arm, goal.pressure), options);
  }
  const auto tip = orThrow(control::checkPosition({goal.tip.x, goal.tip.y, goal.tip.z}));
  return rig.planner.toTip(from, tip, options);
}

}  // namespace helix_arm::ros_bridge
