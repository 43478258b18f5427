#include "ros_bridge/follow/goal_watch.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>

namespace helix_arm::ros_bridge {
namespace {

using Result = FollowTipPathResult;

constexpr double kMemory = 2.0;  // of moments; pictures are younger [s]

template <class... Values>
std::string text(const char* format, Values... values) {
  char out[256];
  std::snprintf(out, sizeof out, format, values...);
  return out;
}

}  // namespace

std::optional<GoalEnding> GoalWatch::turn(double time, const follow::Turn& turn) {
  if (!turn.path_time) {
    return GoalEnding{Result::CONTACT,
                      "contact with the arm, and on_contact is STOP: the path was aborted, "
                      "and the command is held; clear the arm, and send the goal again"};
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
        "the pictures have left what was learnt of the arm (see loop_status): the "
        "camera, the base or the arm may have changed; check them and call ~reset, or "
        "set require_vision to false"};
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
    return GoalEnding{
        Result::VISION_LOST,
        "contact with the arm, and no picture of it since then: the path cannot go on; "
        "check the camera (vision_status), clear the arm, and send the goal again"};
  }
  if (!rules_.require_vision || time - *blind_since_ < patience) return std::nullopt;
  return GoalEnding{Result::VISION_LOST,
                    std::string(was_seen_ ? "the arm is no longer seen" : "the arm is not seen") +
                        "; check vision_status and ~close_loop, or set require_vision to false"};
}

// Result when the path and its tolerance time are over.
GoalEnding GoalWatch::lateEnding(const follow::Turn& turn) const {
  const double tolerance = 1e3 * rules_.goal_tolerance;
  if (last_error_) {
    return {Result::GOAL_TOLERANCE_VIOLATED,
            text("the measured tip is %.2f mm from the last point %g s after the path's end; "
                 "goal_tolerance is %g mm: allow more, or a later end",
                 1e3 * *last_error_, rules_.time_tolerance, tolerance)};
  }
  const double error = turn.predicted
                           ? (turn.predicted->translation - turn.wanted.translation).norm()
                           : std::numeric_limits<double>::infinity();
  if (error <= rules_.goal_tolerance) {
    return {
        Result::SUCCESSFUL,
        text("not seen at its end: the predicted tip is %.2f mm from the last point", 1e3 * error)};
  }
  return {Result::GOAL_TOLERANCE_VIOLATED,
          text("the tip is not seen, and predicted %.2f mm from the last point %g s after the "
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
    return GoalEnding{Result::PATH_TOLERANCE_VIOLATED,
                      text("the measured tip was %.2f mm from the path %.2f s after its start; "
                           "path_tolerance is %g mm: allow more, or a slower path",
                           1e3 * error, moment.path_time, 1e3 * rules_.path_tolerance)};
  }
  last_error_ = error;
  if (error > rules_.goal_tolerance) return std::nullopt;
  return GoalEnding{Result::SUCCESSFUL,
                    text("the measured tip is %.2f mm from the last point", 1e3 * error)};
}

GoalFigures GoalWatch::figures() const {
  if (pictures_ == 0) return {};
  return {std::sqrt(sum2_ / pictures_), max_, pictures_};
}

}  // namespace helix_arm::ros_bridge
