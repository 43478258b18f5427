#include "follow_action.hpp"

#include <algorithm>
#include <atomic>
#include <cmath>
#include <limits>
#include <utility>
#include <variant>

#include "basics/quote.hpp"
#include "basics/text.hpp"
#include "helix_arm/follow/path_check.hpp"
#include "helix_arm/regulator/config.hpp"
#include "loop_reports.hpp"
#include "ros_bridge/common/conversions.hpp"
#include "ros_bridge/names.hpp"

namespace helix_arm::ros_bridge {

FollowAction::FollowAction(ros::NodeHandle& private_node, const io::Scene& scene,
                           const FrameLookup& frames, LoopTargets& targets,
                           follow::VisualServo& loop, const CommandLink& link,
                           const std::optional<procedures::SuspectWatch>& suspects)
    : scene_(scene),
      frames_(frames),
      targets_(targets),
      loop_(loop),
      link_(link),
      suspects_(suspects),
      client_(private_node, names::kFollowTipPath),
      server_(std::make_unique<Server>(
          private_node, names::kFollowTipPath,
          [this](const Handle& handle) { guard_.run("", [&] { onGoal(handle); }); },
          [this](const Handle& handle) { guard_.run("", [&] { onCancel(handle); }); }, false)) {
  server_->start();
}

void FollowAction::prepare(double time) {
  const auto asked = link_.refusal();
  if (asked && asked->fault == control::Fault::kRested) abandon(asked->message);
  takeCandidate();
  if (!run_) {
    if (!link_.follows()) endHold();
    // The goal's reaction holds as long as its last place: a stopped arm does not push on.
    if (!isHeld()) loop_.setOnContact(scene_.follow.on_contact);
    loop_.hold();
    return;
  }
  if (client_.present().isGone()) {
    end({Result::CLIENT_LOST, client_.present().whyGone()});
    endHold();
  } else if (const auto other = targets_.admission().claim(names::kFollowTipPath)) {
    end({Result::NOT_ENABLED, other->message});
  } else if (const auto refusal = link_.refusal()) {
    end({Result::NOT_ENABLED, refusal->message});
  } else if (!link_.blocked().empty()) {
    end({Result::NOT_ENABLED, link_.blocked()});
  } else if (link_.follows() && !run_->follows) {
    begin(time);
  } else if (run_->follows && !link_.follows()) {
    end({Result::NOT_ENABLED, link_.whyNot()});
  }
}

void FollowAction::watch(double time, const follow::Turn& turn) {
  if (!run_ || !run_->follows) return;
  if (const auto ending = run_->watch.turn(time, turn)) endWatched(*ending);
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
  if (const auto ending = run_->watch.picture(*moment, X_BT.translation)) endWatched(*ending);
}

void FollowAction::abandon(const std::string& reason) {
  if (candidate_) {
    reject(*candidate_, {Result::NOT_ENABLED, reason});
    discardCandidate();
  }
  if (run_) end({Result::NOT_ENABLED, reason});
  endHold();
}

FollowAction::Result FollowAction::resultOf(const GoalEnding& ending, const GoalFigures& figures,
                                            const estimation::QuietScore& quiet) {
  Result out;
  out.error_code = ending.code;
  out.error_string = ending.message;
  out.rms_m = figures.rms;
  out.max_m = figures.max;
  out.pictures = figures.pictures;
  out.quiet_score = quiet.highest;
  out.quiet_s = quiet.seconds;
  out.quiet_unit_force = quiet.unit_force;
  return out;
}

follow::OnContact FollowAction::reactionTo(std::uint8_t on_contact, follow::OnContact usual) {
  if (on_contact == FollowTipPathGoal::REPORT) return follow::OnContact::kReport;
  if (on_contact == FollowTipPathGoal::YIELD) return follow::OnContact::kYield;
  return on_contact == FollowTipPathGoal::STOP ? follow::OnContact::kStop : usual;
}

void FollowAction::onGoal(Handle handle) {
  const auto goal = handle.getGoal();
  if (const auto refusal = refusalOf(*goal, scene_.safety.rules.target_timeout)) {
    return reject(handle, *refusal);
  }
  const std::string& frame = goal->path.header.frame_id;
  const auto found = frames_.find(frame);
  const auto* const place = std::get_if<FrameLookup::Place>(&found);
  if (place == nullptr || !place->fixed) {
    return reject(handle, {Result::INVALID_GOAL,
                           place == nullptr
                               ? "the path: " + std::get<control::Refusal>(found).message
                               : "the frame '" + basics::quoted(frame) + "' moves relative to '" +
                                     frames_.baseFrame() +
                                     "'; send the path in a frame with a static transform to it"});
  }
  if (candidate_) {
    candidate_->setCanceled(
        resultOf({Result::SUCCESSFUL,
                  "replaced by a newer goal before its path was checked; wait for the answer to a "
                  "goal before the next one"}));
    discardCandidate();
  }
  checker_.begin([goal, X_BF = place->X_BF, check = pathCheck()](const std::atomic<bool>& stop) {
    return decide(*goal, X_BF, check, stop);
  });
  client_.watchNext(*goal);
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

void FollowAction::reject(Handle& handle, const GoalEnding& refusal) {
  logWarning("follow_tip_path: %s", refusal.message.c_str());
  handle.setRejected(resultOf(refusal), refusal.message);
}

void FollowAction::discardCandidate() {
  checker_.discard();
  client_.next().release();
  candidate_.reset();
}

void FollowAction::takeCandidate() {
  if (candidate_ && client_.next().isGone()) {
    reject(*candidate_, {Result::CLIENT_LOST, client_.next().whyGone()});
    discardCandidate();
  }
  auto decided = checker_.take();
  if (!candidate_ || !decided) return;
  Handle next = std::move(*candidate_);
  candidate_.reset();
  if (const auto* refusal = std::get_if<GoalEnding>(&*decided)) return reject(next, *refusal);
  auto& goal = std::get<PathGoal>(*decided);
  if (goal.hold > longestHold()) {
    return reject(next,
                  {Result::INVALID_GOAL,
                   basics::format("hold_s is %g; expected at most %g on hardware: a tip_target "
                                  "that is repeated keeps the tip where it is for longer",
                                  *goal.hold, longestHold())});
  }
  if (const auto other = targets_.admission().claim(names::kFollowTipPath)) {
    return reject(next, {Result::NOT_ENABLED, other->message});
  }
  if (run_) cancel("replaced by a newer goal");
  next.setAccepted("accepted");
  client_.beginNext();
  const GoalWatch watch(goal.rules, goal.path.lastTime(),
                        [this] { return contactWords(*suspects_); });
  run_.emplace(Run{std::move(next), std::move(goal), watch});
}

void FollowAction::begin(double time) {
  const ros::Time& start = run_->goal.start;
  if (start.isZero() || time >= start.toSec()) {
    run_->follows = true;
    loop_.setOnContact(reactionTo(run_->goal.on_contact, scene_.follow.on_contact));
    loop_.ignoreContacts(run_->goal.ignore_contacts);
    loop_.follow(std::move(run_->goal.path));
  } else if (!loop_.hasTarget() && loop_.turn().predicted) {
    loop_.aimAt(loop_.turn().predicted->translation);
  }
}

PathCheck FollowAction::pathCheck() const {
  Eigen::VectorXd slew(scene_.arm.actuatorCount());
  for (int i = 0; i < scene_.arm.actuatorCount(); ++i) {
    slew[i] = scene_.safety.channels[static_cast<std::size_t>(i)].slew;
  }
  const Eigen::VectorXd start =
      scene_.arm.clamped(link_.setPoint().value_or(scene_.arm.inputAt(0)));
  statics::InverseOptions options;
  options.preference = scene_.follow.preference;
  std::optional<clearance::SweepCheck> zones;
  if (scene_.keep_out) zones.emplace(scene_.model, *scene_.keep_out);
  return [slew, start, options, zones, model = scene_.model,
          correction = loop_.tracker().correction()](const control::TipPath& path, double tolerance,
                                                     const std::atomic<bool>& stop) -> std::string {
    statics::InverseSolver solver(model, options);
    solver.correct(correction);
    const follow::PathRules rules{tolerance, slew, zones ? &*zones : nullptr};
    const auto refusal =
        follow::checkPath(path, model.arm(), solver, start, rules, [&stop] { return stop.load(); });
    return refusal ? refusal->reason : std::string();
  };
}

void FollowAction::endWatched(GoalEnding ending) {
  if (ending.code != Result::SUCCESSFUL) ending.message = ledBySuspect(*suspects_, ending.message);
  end(ending);
}

void FollowAction::end(const GoalEnding& ending) {
  const Result result = resultOfRun(ending);
  const bool done = ending.code == Result::SUCCESSFUL;
  logLine(done ? ros::console::levels::Info : ros::console::levels::Warn, "follow_tip_path: %s",
          ending.message.c_str());
  done ? run_->handle.setSucceeded(result, ending.message)
       : run_->handle.setAborted(result, ending.message);
  leave();
}

void FollowAction::cancel(const std::string& reason) {
  run_->handle.setCanceled(resultOfRun({Result::SUCCESSFUL, reason}), reason);
  leave();
}

FollowAction::Result FollowAction::resultOfRun(const GoalEnding& ending) const {
  const bool ignored = run_->follows && run_->goal.ignore_contacts;
  return resultOf(ending, run_->watch.figures(),
                  ignored ? loop_.quiet() : estimation::QuietScore{});
}

void FollowAction::leave() {
  loop_.ignoreContacts(false);
  const double longest = longestHold();
  const double usual =
      std::isinf(longest) ? longest : std::min(longest, scene_.safety.rules.target_timeout);
  hold_time_ = run_->goal.hold.value_or(usual);
  if (run_->follows) hold_since_ = ros::SteadyTime::now();
  run_.reset();
  client_.present().release();
}

bool FollowAction::isHeld() const {
  return hold_since_ && (ros::SteadyTime::now() - *hold_since_).toSec() < hold_time_;
}

double FollowAction::longestHold() const {
  const bool simulated = scene_.regulator && !regulator::isHardware(*scene_.regulator);
  return simulated ? std::numeric_limits<double>::infinity() : kLongestHold;
}

}  // namespace helix_arm::ros_bridge
