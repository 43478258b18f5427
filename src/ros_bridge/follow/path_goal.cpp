#include "path_goal.hpp"

#include "basics/quote.hpp"
#include "basics/text.hpp"
#include "helix_arm/basics/requirement.hpp"
#include "helix_arm/control/target_check.hpp"
#include "helix_arm/follow/path_check.hpp"
#include "ros_bridge/common/conversions.hpp"
#include "ros_bridge/common/guarded_callbacks.hpp"

namespace helix_arm::ros_bridge {
namespace {

using Goal = FollowTipPathGoal;
using Point = trajectory_msgs::MultiDOFJointTrajectoryPoint;
using Result = FollowTipPathResult;

constexpr double kMemory = 2.0;  // of moments; pictures are younger [s]
constexpr char kJoint[] = "tip";
constexpr double kLatestStart = 60.0;  // ahead of now [s]

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

control::TipPath pathOf(const Goal& goal, const lie::SE3& X_BF) {
  const auto& names = goal.path.joint_names;
  basics::require(names.empty() || (names.size() == 1 && (names[0].empty() || names[0] == kJoint)),
                  "the path has ", names.size(), " joint_names",
                  names.empty() ? "" : ", the first '" + basics::quoted(names[0]) + "'",
                  "; expected none, or `", kJoint, "` alone");
  std::vector<control::TipWayPoint> points;
  points.reserve(goal.path.points.size());
  for (const Point& point : goal.path.points) {
    const std::string culprit = "point " + std::to_string(points.size() + 1) + " of the path: ";
    points.push_back(wayPoint(point, X_BF, goal.mode == Goal::POSE, culprit));
  }
  return control::TipPath(points);
}

void requireNonNegative(const char* what, double value) {
  basics::require(value >= 0, what, " is ", value, "; expected a number >= 0");
}

PathGoal checkedGoal(const Goal& goal, const lie::SE3& X_BF) {
  basics::require(goal.mode <= Goal::POSE, "mode ", static_cast<int>(goal.mode),
                  " is not known; expected 0 (POSITION) or 1 (POSE)");
  basics::require(goal.on_contact <= Goal::STOP, "on_contact ", static_cast<int>(goal.on_contact),
                  " is not known; expected 0 (SCENE), 1 (REPORT), 2 (YIELD) or 3 (STOP)");
  requireNonNegative("path_tolerance [m]", goal.path_tolerance);
  requireNonNegative("goal_tolerance [m]", goal.goal_tolerance);
  requireNonNegative("goal_time_tolerance [s]", goal.goal_time_tolerance.toSec());
  requireNonNegative("hold_s", goal.hold_s);
  PathGoal out{pathOf(goal, X_BF), goal.path.header.stamp,    {},
               goal.on_contact,    goal.ignore_contacts != 0, {}};
  if (goal.path_tolerance > 0) out.rules.path_tolerance = goal.path_tolerance;
  if (goal.goal_tolerance > 0) out.rules.goal_tolerance = goal.goal_tolerance;
  if (!goal.goal_time_tolerance.isZero()) {
    out.rules.time_tolerance = goal.goal_time_tolerance.toSec();
  }
  out.rules.require_vision = goal.require_vision;
  if (goal.hold_s > 0) out.hold = goal.hold_s;
  return out;
}

}  // namespace

std::optional<GoalEnding> GoalWatch::turn(double time, const follow::Turn& turn) {
  if (!turn.path_time) {
    const ContactWords contact = contact_();
    return GoalEnding{Result::CONTACT,
                      contact.what + ", and on_contact is STOP: the path was aborted, and the " +
                          "command is held; " + contact.remedy + ", and send the goal again"};
  }
  if (!moments_.empty() && time < moments_.back().time) {  // a jump back in time
    moments_.clear();
    last_seen_ = time;
  }
  moments_.push_back({time, *turn.path_time, turn.wanted, turn.predicted, turn.state});
  while (moments_.front().time < time - kMemory) moments_.pop_front();
  if (auto ending = visionEnding(time, turn)) return ending;
  if (*turn.path_time > end_ + rules_.time_tolerance) return lateEnding(turn);
  return std::nullopt;
}

std::optional<GoalEnding> GoalWatch::visionEnding(double time, const follow::Turn& turn) {
  const follow::LoopState state = turn.state;
  if (state == follow::LoopState::kDoubtful && rules_.require_vision) {
    return GoalEnding{
        Result::VISION_LOST,
        "the pictures have left what was learnt of the arm (see loop_status): the camera, the base "
        "or the arm may have changed; check them and call ~reset, or set require_vision to false"};
  }
  // This state does not tell whether the arm is seen.
  const bool stands = state == follow::LoopState::kDiverging;
  if (!stands && state != follow::LoopState::kOpen) last_seen_ = time;
  const bool seen = stands ? last_seen_ && time - *last_seen_ < rules_.vision_patience
                           : state != follow::LoopState::kOpen;
  if (seen) {
    was_seen_ = true;
    blind_since_.reset();
    return std::nullopt;
  }
  if (!blind_since_) blind_since_ = time;
  // The loop has already coasted before it opened, or was waited for above.
  const double patience = was_seen_ ? 0.0 : rules_.vision_patience;
  // A path that a contact holds goes on once the arm is seen to be free.
  if (turn.held && time - *blind_since_ >= patience) {
    const ContactWords contact = contact_();
    return GoalEnding{Result::VISION_LOST,
                      contact.what + ", and no picture of it since then: the path cannot go on; " +
                          kCheckVision + "; " + contact.remedy + ", and send the goal again"};
  }
  if (!rules_.require_vision || time - *blind_since_ < patience) return std::nullopt;
  return GoalEnding{Result::VISION_LOST,
                    std::string(was_seen_ ? "the arm is no longer seen" : "the arm is not seen") +
                        "; " + kCheckVision + ", and ~close_loop, or set require_vision to false"};
}

// Result when the path and its tolerance time are over.
GoalEnding GoalWatch::lateEnding(const follow::Turn& turn) const {
  const double tolerance = 1e3 * rules_.goal_tolerance;
  if (last_error_) {
    return {
        Result::GOAL_TOLERANCE_VIOLATED,
        basics::format("the measured tip is %.2f mm from the last point %g s after the path's end; "
                       "goal_tolerance is %g mm: allow more, or a later end",
                       1e3 * *last_error_, rules_.time_tolerance, tolerance)};
  }
  const double error = turn.predicted
                           ? (turn.predicted->translation - turn.wanted.translation).norm()
                           : std::numeric_limits<double>::infinity();
  if (error <= rules_.goal_tolerance) {
    return {Result::SUCCESSFUL,
            basics::format("not seen at its end: the predicted tip is %.2f mm from the last point",
                           1e3 * error)};
  }
  return {Result::GOAL_TOLERANCE_VIOLATED,
          basics::format(
              "the tip is not seen, and predicted %.2f mm from the last point %g s after the "
              "path's end; goal_tolerance is %g mm",
              1e3 * error, rules_.time_tolerance, tolerance)};
}

std::optional<GoalWatch::Moment> GoalWatch::momentOf(double stamp) const {
  const auto later =
      std::upper_bound(moments_.begin(), moments_.end(), stamp,
                       [](double wanted, const Moment& moment) { return wanted < moment.time; });
  if (later == moments_.begin()) return std::nullopt;
  Moment out = *(later - 1);
  if (later == moments_.end()) return out;
  const double part = (stamp - out.time) / (later->time - out.time);
  const auto approach = [part](auto& value, const auto& next) { value += part * (next - value); };
  out.time = stamp;
  approach(out.path_time, later->path_time);
  approach(out.wanted.translation, later->wanted.translation);
  if (out.predicted && later->predicted) {
    approach(out.predicted->translation, later->predicted->translation);
  }
  return out;
}

std::optional<GoalEnding> GoalWatch::picture(const Moment& moment, const Eigen::Vector3d& tip) {
  last_seen_ = std::max(last_seen_.value_or(moment.time), moment.time);
  if (moment.path_time < 0) return std::nullopt;
  const double error = (tip - moment.wanted.translation).norm();
  if (moment.path_time <= end_) {
    sum2_ += error * error;
    max_ = std::max(max_, error);
    ++pictures_;
    if (error <= rules_.path_tolerance) return std::nullopt;
    return GoalEnding{
        Result::PATH_TOLERANCE_VIOLATED,
        basics::format("the measured tip was %.2f mm from the path %.2f s after its start; "
                       "path_tolerance is %g mm: allow more, or a slower path",
                       1e3 * error, moment.path_time, 1e3 * rules_.path_tolerance)};
  }
  last_error_ = error;
  if (error > rules_.goal_tolerance) return std::nullopt;
  return GoalEnding{Result::SUCCESSFUL,
                    basics::format("the measured tip is %.2f mm from the last point", 1e3 * error)};
}

std::optional<GoalEnding> refusalOf(const Goal& goal, double max_age) {
  const std::size_t points = goal.path.points.size();
  const ros::Time& start = goal.path.header.stamp;
  const double age = start.isZero() ? 0.0 : secondsBetween(start, ros::Time::now());
  try {
    basics::require(points <= control::kMostWayPoints, "the path has ", points,
                    " points; expected at most ", control::kMostWayPoints, ": send it in parts");
    basics::require(-age <= kLatestStart, "the path starts in ", -age, " s; expected at most ",
                    kLatestStart, " s");
  } catch (const std::invalid_argument& fault) {
    return GoalEnding{Result::INVALID_GOAL, fault.what()};
  }
  if (age <= max_age) return std::nullopt;
  return GoalEnding{
      Result::OLD_HEADER_TIMESTAMP,
      "the path was to start " + std::to_string(age) +
          " s ago (header.stamp); send 0 to start at once, and synchronise the clocks"};
}

DecidedGoal decide(const Goal& goal, const lie::SE3& X_BF, const PathCheck& check,
                   const std::atomic<bool>& stop) {
  try {
    PathGoal out = checkedGoal(goal, X_BF);
    const double tolerance = out.rules.path_tolerance;
    const std::string why_not =
        check(out.path, std::isfinite(tolerance) ? tolerance : follow::kPathTolerance, stop);
    if (!why_not.empty()) return GoalEnding{Result::INVALID_GOAL, why_not};
    return out;
  } catch (const std::exception& fault) {
    return GoalEnding{Result::INVALID_GOAL, fault.what()};
  }
}

}  // namespace helix_arm::ros_bridge
