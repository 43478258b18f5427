#include "helix_arm/ros_bridge/follow/path_goal.hpp"

#include <cmath>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "helix_arm/basics/quote.hpp"
#include "helix_arm/basics/requirement.hpp"
#include "helix_arm/ros_bridge/common/model_history.hpp"

namespace helix_arm::ros_bridge {
namespace {

using Goal = FollowTipPathGoal;
using Result = FollowTipPathResult;
using Point = trajectory_msgs::MultiDOFJointTrajectoryPoint;

constexpr char kJoint[] = "tip";
constexpr double kLatestStart = 60.0;  // ahead of now [s]

template <class T>
T orThrow(control::Checked<T> checked, const std::string& culprit) {
  const auto* refusal = std::get_if<control::Refusal>(&checked);
  if (refusal != nullptr) throw std::invalid_argument(culprit + refusal->message);
  return std::get<T>(std::move(checked));
}

// Converts a point of the path, which is given in frame F.
control::TipWayPoint wayPoint(const Point& point, const lie::SE3& X_BF, bool with_rotation,
                              const std::string& culprit) {
  basics::require(point.transforms.size() == 1, culprit, "it has ", point.transforms.size(),
                  " transforms; expected only that of the tip");
  basics::require(point.velocities.size() <= 1, culprit, "it has ", point.velocities.size(),
                  " velocities; expected that of the tip, or none");
  const auto& p = point.transforms[0].translation;
  const auto& q = point.transforms[0].rotation;
  control::TipWayPoint out;
  out.time = point.time_from_start.toSec();
  if (with_rotation) {
    const lie::SE3 X_BT =
        X_BF * orThrow(control::checkPose({p.x, p.y, p.z}, {q.w, q.x, q.y, q.z}), culprit);
    out.position = X_BT.translation;
    out.rotation = X_BT.rotation;
  } else {
    out.position = X_BF * orThrow(control::checkPosition({p.x, p.y, p.z}), culprit);
  }
  if (!point.velocities.empty()) {
    const auto& v = point.velocities[0].linear;
    out.velocity = X_BF.rotation * Eigen::Vector3d(v.x, v.y, v.z);
  }
  return out;
}

control::TipPath pathOf(const Goal& goal, const FrameLookup& frames) {
  const auto& names = goal.path.joint_names;
  basics::require(names.empty() || (names.size() == 1 && (names[0].empty() || names[0] == kJoint)),
                  "the path has ", names.size(), " joint_names",
                  names.empty() ? "" : ", the first '" + basics::quoted(names[0]) + "'",
                  "; expected none, or `", kJoint, "` alone");
  const std::string& frame = goal.path.header.frame_id;
  const auto place = orThrow(frames.find(frame), "the path: ");
  basics::require(place.fixed, "the frame '", basics::quoted(frame), "' moves relative to '",
                  frames.baseFrame(), "'; send the path in a frame with a static transform to it");
  std::vector<control::TipWayPoint> points;
  points.reserve(goal.path.points.size());
  for (const Point& point : goal.path.points) {
    const std::string culprit = "point " + std::to_string(points.size() + 1) + " of the path: ";
    points.push_back(wayPoint(point, place.X_BF, goal.mode == Goal::POSE, culprit));
  }
  return control::TipPath(points);
}

void requireNonNegative(const char* what, double value) {
  basics::require(value >= 0, what, " is ", value, "; expected a number >= 0");
}

PathGoal checkedGoal(const Goal& goal, const FrameLookup& frames) {
  basics::require(goal.mode <= Goal::POSE, "mode ", static_cast<int>(goal.mode),
                  " is not known; expected 0 (POSITION) or 1 (POSE)");
  basics::require(goal.on_contact <= Goal::STOP, "on_contact ", static_cast<int>(goal.on_contact),
                  " is not known; expected 0 (SCENE), 1 (REPORT), 2 (YIELD) or 3 (STOP)");
  requireNonNegative("path_tolerance [m]", goal.path_tolerance);
  requireNonNegative("goal_tolerance [m]", goal.goal_tolerance);
  requireNonNegative("goal_time_tolerance [s]", goal.goal_time_tolerance.toSec());
  requireNonNegative("hold_s", goal.hold_s);
  PathGoal out{pathOf(goal, frames), goal.path.header.stamp, {}, goal.on_contact, {}};
  if (goal.path_tolerance > 0) out.rules.path_tolerance = goal.path_tolerance;
  if (goal.goal_tolerance > 0) out.rules.goal_tolerance = goal.goal_tolerance;
  if (!goal.goal_time_tolerance.isZero()) {
    out.rules.time_tolerance = goal.goal_time_tolerance.toSec();
  }
  out.rules.require_sight = goal.require_sight;
  if (goal.hold_s > 0) out.hold = goal.hold_s;
  return out;
}

}  // namespace

std::variant<PathGoal, GoalEnding> fromMsg(const FollowTipPathGoal& goal, const FrameLookup& frames,
                                           double max_age) {
  const ros::Time& start = goal.path.header.stamp;
  const double age = start.isZero() ? 0.0 : secondsBetween(start, ros::Time::now());
  try {
    PathGoal out = checkedGoal(goal, frames);
    if (age > max_age) {
      return GoalEnding{
          Result::OLD_HEADER_TIMESTAMP,
          "the path was to start " + std::to_string(age) +
              " s ago (header.stamp); send 0 to start at once, and synchronise the clocks"};
    }
    basics::require(-age <= kLatestStart, "the path starts in ", -age, " s; expected at most ",
                    kLatestStart, " s");
    return out;
  } catch (const std::invalid_argument& fault) {
    return GoalEnding{Result::INVALID_GOAL, fault.what()};
  }
}

}  // namespace helix_arm::ros_bridge
