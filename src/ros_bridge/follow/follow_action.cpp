#include "follow_action.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <sstream>
#include <utility>
#include <variant>

#include "helix_arm/regulator/config.hpp"
#include "ros_bridge/common/conversions.hpp"
#include "ros_bridge/common/log.hpp"
#include "ros_bridge/names.hpp"

namespace helix_arm::ros_bridge {
namespace {

using Result = FollowTipPathResult;

Result resultOf(const GoalEnding& ending, const GoalFigures& figures = {}) {
  Result out;
  out.error_code = ending.code;
  out.error_string = ending.message;
  out.rms_m = figures.rms;
  out.max_m = figures.max;
  out.pictures = figures.pictures;
  return out;
}

// Reaction that a goal requests; the scene's by default.
follow::OnContact reactionTo(std::uint8_t on_contact, follow::OnContact usual) {
  switch (on_contact) {
    case FollowTipPathGoal::REPORT:
      return follow::OnContact::kReport;
    case FollowTipPathGoal::YIELD:
      return follow::OnContact::kYield;
    case FollowTipPathGoal::STOP:
      return follow::OnContact::kStop;
    default:
      return usual;
  }
}

}  // namespace

FollowAction::FollowAction(ros::NodeHandle& private_node, const io::Scene& scene,
                           const FrameLookup& frames, LoopTargets& targets,
                           MakePathCheck make_check)
    : scene_(scene),
      frames_(frames),
      targets_(targets),
      make_check_(std::move(make_check)),
      client_(private_node, names::kFollowTipPath),
      server_(std::make_unique<Server>(
          private_node, names::kFollowTipPath,
          [this](const Handle& handle) { guard_.run("", [&] { onGoal(handle); }); },
          [this](const Handle& handle) { guard_.run("", [&] { onCancel(handle); }); }, false)) {
  server_->start();
}

void FollowAction::onGoal(Handle handle) {
  const UnreadGoal goal = *handle.getGoal();
  if (const auto refusal = refusalOf(goal, scene_.safety.rules.target_timeout)) {
    reject(handle, *refusal);
    return;
  }
  const auto frame = frameOf(goal, frames_);
  if (const auto* refusal = std::get_if<GoalEnding>(&frame)) {
    reject(handle, *refusal);
    return;
  }
  if (candidate_) {
    candidate_->setCanceled(
        resultOf({Result::SUCCESSFUL,
                  "replaced by a newer goal before its path was checked; wait for the answer to a "
                  "goal before the next one"}));
    discardCandidate();
  }
  checker_.begin([goal, X_BF = std::get<lie::SE3>(frame), check = make_check_()](
                     const std::atomic<bool>& stop) { return decide(goal, X_BF, check, stop); });
  client_.watchNext(*handle.getGoal());
  candidate_ = std::move(handle);
}

void FollowAction::onCancel(Handle handle) {
  if (candidate_ && *candidate_ == handle) {
    handle.setCanceled(resultOf({Result::SUCCESSFUL, "cancelled before it began"}));
    discardCandidate();
  } else if (run_ && run_->handle == handle) {
    cancel("cancelled: the arm stays where it was wanted");
  }
}

void FollowAction::takeCandidate() {
  if (candidate_ && client_.nextIsGone()) {
    reject(*candidate_, {Result::CLIENT_LOST, client_.whyNextGone()});
    discardCandidate();
  }
  auto decided = checker_.take();
  if (!candidate_ || !decided) return;
  Handle next = std::move(*candidate_);
  candidate_.reset();
  if (const auto* refusal = std::get_if<GoalEnding>(&*decided)) {
    reject(next, *refusal);
    return;
  }
  auto& goal = std::get<PathGoal>(*decided);
  if (goal.hold > longestHold()) {
    std::ostringstream text;
    text << "hold_s is " << *goal.hold << "; expected at most " << longestHold()
         << " on hardware: a tip_target that is repeated keeps the tip where it is for longer";
    reject(next, {Result::INVALID_GOAL, text.str()});
    return;
  }
  if (const auto other = targets_.claim(names::kFollowTipPath)) {
    reject(next, {Result::NOT_ENABLED, other->message});
    return;
  }
  if (run_) cancel("replaced by a newer goal");
  next.setAccepted("accepted");
  client_.beginNext();
  const GoalWatch watch(goal.rules, goal.path.lastTime());
  run_.emplace(Run{std::move(next), std::move(goal), watch});
}

void FollowAction::prepare(double time, follow::VisualServo& loop, const CommandLink& link) {
  const auto asked = link.refusal();
  if (asked && asked->fault == control::Fault::kRested) abandon(asked->message);
  takeCandidate();
  if (!run_) {
    if (!link.follows()) endHold();
    // The goal's reaction holds as long as its last place: a stopped arm does not push on.
    if (!isHeld()) loop.setOnContact(scene_.follow.on_contact);
    loop.hold();
    return;
  }
  if (client_.isGone()) {
    end({Result::CLIENT_LOST, client_.whyGone()});
    endHold();
  } else if (const auto other = targets_.claim(names::kFollowTipPath)) {
    end({Result::NOT_ENABLED, other->message});
  } else if (const auto refusal = link.refusal()) {
    end({Result::NOT_ENABLED, refusal->message});
  } else if (link.follows() && !run_->follows) {
    begin(time, loop);
  } else if (run_->follows && !link.follows()) {
    end({Result::NOT_ENABLED, link.whyNot()});
  }
}

void FollowAction::begin(double time, follow::VisualServo& loop) {
  const ros::Time& start = run_->goal.start;
  if (start.isZero() || time >= start.toSec()) {
    run_->follows = true;
    loop.setOnContact(reactionTo(run_->goal.on_contact, scene_.follow.on_contact));
    loop.follow(std::move(run_->goal.path));
  } else if (!loop.hasTarget() && loop.turn().predicted) {
    loop.aimAt(loop.turn().predicted->translation);
  }
}

void FollowAction::picture(const ros::Time& stamp, const lie::SE3& X_BT,
                           const Eigen::Matrix3d& tip_covariance) {
  if (!run_ || !run_->follows) return;
  const auto moment = run_->watch.momentOf(stamp.toSec());
  if (!moment) return;
  const Eigen::Vector3d error = X_BT.translation - moment->wanted.translation;
  const Eigen::Vector3d direction = error.stableNormalized();
  FollowTipPathFeedback feedback;
  feedback.header = toHeaderMsg(stamp, frames_.baseFrame());
  feedback.desired = toPoseMsg(moment->wanted);
  feedback.measured = toPoseMsg(X_BT);
  if (moment->predicted) feedback.predicted = toPoseMsg(*moment->predicted);
  feedback.error = error.norm();
  feedback.sd = std::sqrt(std::max(0.0, direction.dot(tip_covariance * direction)));
  feedback.state = follow::nameOf(moment->state);
  feedback.time_from_start = ros::Duration(moment->path_time);
  run_->handle.publishFeedback(feedback);
  if (const auto ending = run_->watch.picture(*moment, X_BT.translation)) end(*ending);
}

void FollowAction::abandon(const std::string& reason) {
  if (candidate_) {
    reject(*candidate_, {Result::NOT_ENABLED, reason});
    discardCandidate();
  }
  if (run_) end({Result::NOT_ENABLED, reason});
  endHold();
}

void FollowAction::end(const GoalEnding& ending) {
  const Result result = resultOf(ending, run_->watch.figures());
  if (ending.code == Result::SUCCESSFUL) {
    logInfo("follow_tip_path: %s", ending.message.c_str());
    run_->handle.setSucceeded(result, ending.message);
  } else {
    logWarning("follow_tip_path: %s", ending.message.c_str());
    run_->handle.setAborted(result, ending.message);
  }
  leave();
}

// The last position is held if the arm was moved there.
void FollowAction::leave() {
  const double longest = longestHold();
  const double usual =
      std::isinf(longest) ? longest : std::min(longest, scene_.safety.rules.target_timeout);
  hold_time_ = run_->goal.hold.value_or(usual);
  if (run_->follows) hold_since_ = ros::SteadyTime::now();
  run_.reset();
  client_.release();
}

}  // namespace helix_arm::ros_bridge
