
#include <actionlib/server/action_server.h>
#include <geometry_msgs/PoseStamped.h>
#include <std_srvs/SetBool.h>
#include <std_srvs/Trigger.h>

#include "helix_arm/FollowTipPathAction.h"
#include "helix_arm/SafetyState.h"
#include "helix_arm/ShapeTarget.h"
#include "helix_arm/basics/quote.hpp"
#include "helix_arm/basics/requirement.hpp"
#include "helix_arm/follow/path_check.hpp"
#include "helix_arm/procedures/calibration_job.hpp"
#include "helix_arm/procedures/follow_run.hpp"
#include "helix_arm/regulator/config.hpp"
#include "helix_arm/regulator/regulator_io.hpp"
#include "loop_reports.hpp"
#include "path_goal.hpp"
#include "ros_bridge/common/arm_frames.hpp"
#include "ros_bridge/common/client_watch.hpp"
#include "ros_bridge/common/parameters.hpp"
#include "ros_bridge/pressure/target_admission.hpp"

namespace helix_arm::ros_bridge {
namespace {

// Covariance of the twists of a `measured`, or why it cannot be used.
control::Checked<Eigen::MatrixXd> covarianceOf(const ArmShape& shape, int sections) {
  const auto size = static_cast<Eigen::Index>(6) * sections;
  if (shape.twist_covariance.size() != static_cast<std::size_t>(size * size)) {
    return control::Refusal{control::Fault::kWrongSize,
                            std::to_string(shape.twist_covariance.size()) +
                                " numbers in twist_covariance; send " +
                                std::to_string(size * size) + ", the covariance of `twist`"};
  }
  return Eigen::Map<const Eigen::MatrixXd>(shape.twist_covariance.data(), size, size).eval();
}

using control::Fault;

constexpr double kFreshCommand = 1.0;   // an older one is of a node that has ended [s]
constexpr double kLeasePatience = 1.0;  // beyond the lease of another commander [s]
constexpr double kLongestLease = 5.0;   // that is waited for [s]

/// The loop as one commander of pressure_command among others: sends it pressures, and knows
/// whether the arm follows them.
///
/// Before the arm follows, targets that keep it where it is are sent: they enable a simulated arm,
/// wait for the lease of a commander that yields, and are refused without a motion. Nothing here
/// enables an arm that its targets do not. For the thread of the node's callback queue.
class CommandLink {
 public:
  /// @param scene  Its arm and safety rules are used. Kept by reference.
  CommandLink(ros::NodeHandle& node, const io::Scene& scene)
      : scene_(scene),
        target_publisher_(node.advertise<PressureArray>(names::kPressureTarget, 10)),
        command_subscriber_(
            listen(node, names::kPressureCommand, 10, &CommandLink::onCommand, this)),
        safety_subscriber_(listen(node, names::kSafetyState, 10, &CommandLink::onSafety, this)),
        status_subscriber_(listen(node, names::kTargetStatus, 100, &CommandLink::onStatus, this)) {}

  /// Whether the arm is enabled and follows this node, by the last messages.
  bool follows() const { return speaks_ && accepted_ && enabled_ && isFresh(); }
  /// (n) last pressure_command, in force since about that time; nothing before the first [Pa].
  const std::optional<Eigen::VectorXd>& setPoint() const { return set_point_; }

  /// Sends (n) pressures inside the limits [Pa].
  void send(const Eigen::VectorXd& pressure) {
    if (!speaks_ || follows()) asks_since_ = ros::SteadyTime::now();
    std_msgs::Header header = toHeaderMsg(ros::Time::now());
    if (!speaks_ || header.stamp < first_stamp_) first_stamp_ = header.stamp;
    speaks_ = true;
    rests_ = false;
    trace_.sent(header.stamp);
    target_publisher_.publish(toPressureMsg(header, scene_.arm, pressure));
  }
  /// Sends a target that keeps the arm where it is.
  void ask() {
    if (trace_.wasRested()) return;  // until pressure_command knows that this node knows
    send(scene_.arm.clamped(set_point_ ? *set_point_ : scene_.arm.inputAt(0)));
  }
  /// Sends nothing from now on. Without another commander the arm then vents, as after a fault.
  void fallSilent() {
    speaks_ = accepted_ = false;
    passing_.reset();
    lasting_.reset();
  }
  /// Sends nothing from now on, and asks for rest once the last target is answered: the loop is
  /// done. Until it sends again, or another commands the arm.
  void rest() {
    rests_ = rests_ || follows() || trace_.awaitsAnswer();
    fallSilent();
  }
  /// Asks for the rest that is due, or tells that it knows of the rest that somebody else asked
  /// for: until then it sends nothing. To be called regularly; waits for the answer.
  void restIfDue() {
    const bool was_rested = trace_.wasRested();
    if ((!rests_ && !was_rested) || trace_.awaitsAnswer()) return;
    rests_ = false;
    if (was_rested || trace_.commands()) requestRest();
    trace_ = {};
  }
  /// Commands the arm, may do so once it answers, or is to bring it to rest.
  bool isBusy() const { return follows() || rests_ || (speaks_ && trace_.awaitsAnswer()); }

  /// Whether the arm was enabled since the last call.
  bool takeEnabling() { return std::exchange(was_enabled_anew_, false); }

  /// Why the arm does not follow, where waiting does not help; nothing while it follows or may yet.
  std::optional<control::Refusal> refusal() const {
    if (!speaks_ || follows()) return std::nullopt;
    if (lasting_) return lasting_;
    const double patience =
        kLeasePatience + std::min(scene_.safety.commander_timeout, kLongestLease);
    if (ros::SteadyTime::now() - asks_since_ < ros::WallDuration(patience)) return std::nullopt;
    if (passing_ && isFresh()) return passing_;
    return control::Refusal{Fault::kNotEnabled, whyNot()};
  }
  /// Why the arm does not follow now.
  std::string whyNot() const {
    if (!isFresh()) return "no pressure_command is received; is its node running?";
    if (lasting_) return lasting_->message;
    if (passing_) return passing_->message;
    if (!enabled_ && !safety_reason_.empty()) return safety_reason_;
    return "pressure_command does not answer on target_status";
  }

 private:
  void onCommand(const PressureArrayConstPtr& command) {
    auto checked = control::checkReading(scene_.arm, command->name, command->pressure);
    if (auto* pressure = std::get_if<Eigen::VectorXd>(&checked)) {
      set_point_ = std::move(*pressure);
      last_command_ = ros::SteadyTime::now();
    } else if (bad_commands_.add()) {
      logWarning("a pressure_command was dropped (%lu so far): %s", bad_commands_.total(),
                 std::get<control::Refusal>(checked).message.c_str());
    }
  }

  void onSafety(const SafetyStateConstPtr& state) {
    const bool was_enabled = std::exchange(enabled_, state->state == SafetyState::ENABLED);
    was_enabled_anew_ = was_enabled_anew_ || (enabled_ && !was_enabled);
    safety_reason_ = basics::quoted(state->reason, kLongestMessage);
    if (!enabled_) accepted_ = false;
  }

  void onStatus(const TargetStatusConstPtr& status) {
    if (status->topic != names::kPressureTarget) return;  // such as answers to targets of this node
    trace_.answered(*status);
    if (!speaks_ || status->commander != ros::this_node::getName() ||
        status->target_stamp < first_stamp_) {
      return;
    }
    if (status->outcome != TargetStatus::DROPPED) {
      accepted_ = true;
      passing_.reset();
      return;
    }
    const auto is = [&](Fault fault) { return status->fault == control::nameOf(fault); };
    const Fault fault = is(Fault::kOtherCommander) ? Fault::kOtherCommander
                        : is(Fault::kRested)       ? Fault::kRested
                                                   : Fault::kNotEnabled;
    const control::Refusal refusal{fault, basics::quoted(status->message, kLongestMessage)};
    const bool stale = is(Fault::kStale);
    // A commander that had the arm and lost it does not wait for it again.
    const bool passes = stale || (is(Fault::kOtherCommander) && !accepted_);
    accepted_ = accepted_ && stale;
    (passes ? passing_ : lasting_) = refusal;
  }

  bool isFresh() const {
    return !last_command_.isZero() &&
           ros::SteadyTime::now() - last_command_ < ros::WallDuration(kFreshCommand);
  }

  const io::Scene& scene_;
  std::optional<Eigen::VectorXd> set_point_;
  ros::SteadyTime last_command_;  ///< zero: none yet
  bool enabled_ = false;
  bool was_enabled_anew_ = false;
  std::string safety_reason_;  ///< empty: safety_state has not come yet

  bool speaks_ = false;         ///< targets are sent
  ros::Time first_stamp_;       ///< of them; answers to earlier ones do not count
  bool accepted_ = false;       ///< by the last answer to them
  ros::SteadyTime asks_since_;  ///< targets are sent that the arm does not follow
  std::optional<control::Refusal> passing_, lasting_;  ///< last refusals
  CommandTrace trace_;
  bool rests_ = false;  ///< rest is asked for when the last target is answered
  FaultCount bad_commands_;

  ros::Publisher target_publisher_;
  ros::Subscriber command_subscriber_, safety_subscriber_, status_subscriber_;
};

bool areEqual(const follow::Target& a, const follow::Target& b) {
  if (a.index() != b.index()) return false;
  if (const auto* pose = std::get_if<lie::SE3>(&a)) {
    const auto& other = std::get<lie::SE3>(b);
    return pose->translation == other.translation && pose->rotation == other.rotation;
  }
  const auto* position = std::get_if<Eigen::Vector3d>(&a);
  return position ? *position == std::get<Eigen::Vector3d>(b)
                  : std::get<model::Twists>(a) == std::get<model::Twists>(b);
}

/// The target that messages ask the loop for, until their sender falls silent. Each is answered on
/// target_status, when the loop has tried it. For the thread of the node's callback queue.
class LoopTargets {
 public:
  /// @param scene   As TargetAdmission's.
  /// @param frames  Outlives this.
  LoopTargets(ros::NodeHandle& node, const io::Scene& scene, const FrameLookup& frames)
      : scene_(scene),
        frames_(frames),
        admission_(node, scene),
        tip_subscriber_(listen(node, names::kTipTarget, 10, &LoopTargets::onTipTarget, this)),
        pose_subscriber_(listen(node, names::kTipPose, 10, &LoopTargets::onTipPose, this)),
        shape_subscriber_(
            listen(node, names::kShapeTarget, 10, &LoopTargets::onShapeTarget, this)) {}

  /// A target from the interactive marker, whose stamp is not checked.
  void takeFromHandle(const TipTarget& target) {
    aimTip(TargetSender(target.header.stamp), target);
  }

  /// Of these targets, and of a commander that sends no messages.
  TargetAdmission& admission() { return admission_; }

  /// The present target, base frame; nothing where its sender was silent for
  /// safety.target_timeout_s.
  const std::optional<follow::Target>& target() {
    if (target_ && isSilent()) forget();
    return target_;
  }
  /// Whether the target is another than at the last call.
  bool takeChange() { return std::exchange(changed_, false); }
  /// Forgets the target.
  void forget() {
    target_.reset();
    commander_.clear();
    changed_ = false;
  }
  /// Who sent it, or the target that was refused; empty without either.
  const std::string& commander() const {
    return commander_.empty() && isRefused() ? refused_commander_ : commander_;
  }
  /// Why the last target was refused, until its sender falls silent; empty where it was not.
  /// Repeated targets are refused one by one: without this a status would change with each.
  std::string refusal() const { return isRefused() ? refusal_ : ""; }

  /// Answers the messages that wait for it: the loop commands the target.
  void answer(const TargetSolution& solution) {
    refusal_.clear();
    for (const TargetSender& sender : unanswered_) admission_.accept(sender, solution);
    unanswered_.clear();
  }

  /// Answers them, and forgets the target. After a rest (Fault::kRested), whoever commands must
  /// pause for safety.target_timeout before its next target counts, or the arm be enabled.
  void refuse(const control::Refusal& refusal) {
    if (refusal.fault == control::Fault::kRested) rested_.hold("", regulator::steadyNow());
    if (target_) {
      refusal_ = refusal.message;
      refused_commander_ = commander_;
    }
    for (const TargetSender& sender : unanswered_) admission_.drop(sender, refusal);
    unanswered_.clear();
    forget();
  }

  /// The arm was enabled: whoever was brought to rest may command again.
  void enabled() { rested_.release(); }

 private:
  void onTipTarget(const ros::MessageEvent<const TipTarget>& event) {
    aimTip({names::kTipTarget, event}, *event.getMessage());
  }

  void onTipPose(const ros::MessageEvent<const geometry_msgs::PoseStamped>& event) {
    const geometry_msgs::PoseStamped& pose = *event.getMessage();
    TipTarget target;
    target.header = pose.header;
    const geometry_msgs::Quaternion& q = pose.pose.orientation;
    const bool is_set = !Eigen::Vector4d(q.x, q.y, q.z, q.w).isZero(0);
    target.mode = is_set ? TipTarget::POSE : TipTarget::POSITION;
    target.pose = pose.pose;
    aimTip({names::kTipPose, event}, target);
  }

  void onShapeTarget(const ros::MessageEvent<const ShapeTarget>& event) {
    const TargetSender sender(names::kShapeTarget, event);
    const auto checked = control::checkTwists(scene_.arm.sectionCount(), event.getMessage()->twist);
    if (const model::Twists* twists = admission_.admit(sender, checked)) set(sender, *twists);
  }

  bool isSilent() const {
    return (ros::SteadyTime::now() - last_target_).toSec() > scene_.safety.rules.target_timeout;
  }
  bool isRefused() const { return !refusal_.empty() && !isSilent(); }

  /// The goal of a tip target in any frame that tf knows.
  control::Checked<TipGoal> seenFromBase(const TipTarget& target) const {
    const std::string& frame = target.header.frame_id;
    const auto place = frames_.find(frame);
    if (const auto* refusal = std::get_if<control::Refusal>(&place)) return *refusal;
    const auto checked = fromMsg(target, frame);
    if (const auto* refusal = std::get_if<control::Refusal>(&checked)) return *refusal;
    TipGoal goal = std::get<TipGoal>(checked);
    goal.X_BT = std::get<FrameLookup::Place>(place).X_BF * goal.X_BT;
    const auto inside = control::checkPosition(goal.X_BT.translation);
    if (const auto* refusal = std::get_if<control::Refusal>(&inside)) return *refusal;
    return goal;
  }

  void aimTip(const TargetSender& sender, const TipTarget& target) {
    const auto checked = seenFromBase(target);
    const TipGoal* goal = admission_.admit(sender, checked);
    if (goal == nullptr) return;
    set(sender, goal->with_rotation ? follow::Target(goal->X_BT) : goal->X_BT.translation);
  }

  void set(const TargetSender& sender, const follow::Target& target) {
    const double pause = scene_.safety.rules.target_timeout;
    if (rested_.refuses(sender.commander, regulator::steadyNow(), pause)) {
      return admission_.drop(sender, control::restedRefusal(pause));
    }
    // A repeated target renews the lease but does not restart the watch for divergence.
    changed_ = changed_ || !target_ || !areEqual(*target_, target);
    target_ = target;
    commander_ = sender.commander;
    last_target_ = ros::SteadyTime::now();
    unanswered_.push_back(sender);
  }

  const io::Scene& scene_;
  const FrameLookup& frames_;
  TargetAdmission admission_;
  control::RestedCommanders rested_;
  std::optional<follow::Target> target_;
  bool changed_ = false;
  std::string commander_;
  std::string refusal_, refused_commander_;
  ros::SteadyTime last_target_;
  std::vector<TargetSender> unanswered_;
  ros::Subscriber tip_subscriber_, pose_subscriber_, shape_subscriber_;
};

using Result = FollowTipPathResult;

Result resultOf(const GoalEnding& ending, const GoalFigures& figures = {},
                const estimation::QuietScore& quiet = {}) {
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

// Reaction that a goal requests; the scene's by default.
follow::OnContact reactionTo(std::uint8_t on_contact, follow::OnContact usual) {
  if (on_contact == FollowTipPathGoal::REPORT) return follow::OnContact::kReport;
  if (on_contact == FollowTipPathGoal::YIELD) return follow::OnContact::kYield;
  return on_contact == FollowTipPathGoal::STOP ? follow::OnContact::kStop : usual;
}

/// Serves the action ~follow_tip_path: has a goal checked, lets the loop follow its path, and
/// decides how it ends. Afterwards the last wanted place is held for a time.
///
/// A goal lives as long as the node that sent it. Where that is gone, the goal is aborted and
/// nothing is held, so that the arm vents. On hardware, a place is held for kLongestHold at most.
///
/// A new goal replaces the running one once it is accepted, and one whose path is still being
/// checked at once. A running goal holds the lease of the loop's commanders. All of it belongs to
/// the thread of the node's callback queue, except what a PathChecker does: it checks the path.
class FollowAction {
 public:
  /// Longest time for which hardware stands at the last place of a goal [s].
  static constexpr double kLongestHold = 60.0;

  /// @param scene, frames, targets, loop, link, suspects  Outlive this.
  FollowAction(ros::NodeHandle& private_node, const io::Scene& scene, const FrameLookup& frames,
               LoopTargets& targets, follow::VisualServo& loop, const CommandLink& link,
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

  /// A goal runs, or waits for its start or for the arm.
  bool runs() const { return run_.has_value(); }
  /// The arm is to be commanded: a goal runs, or its last place is held.
  bool wants() const { return run_.has_value() || isHeld(); }
  /// Whether a hold has run out since the last call.
  bool takeEndOfHold() { return !wants() && std::exchange(hold_since_, std::nullopt); }
  /// No longer holds the last place of a goal: another command has come.
  void endHold() { hold_since_.reset(); }

  /// Before each turn of the loop: takes goals up and begins paths. @param time  of the turn [s].
  void prepare(double time) {
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
    } else if (link_.follows() && !run_->follows) {
      begin(time);
    } else if (run_->follows && !link_.follows()) {
      end({Result::NOT_ENABLED, link_.whyNot()});
    }
  }

  /// After a turn in which the loop commands.
  void watch(double time, const follow::Turn& turn) {
    if (!run_ || !run_->follows) return;
    if (const auto ending = run_->watch.turn(time, turn)) endWatched(*ending);
  }

  /// After a picture that the loop used.
  /// @param X_BT            measured tip.
  /// @param tip_covariance  of the predicted tip's position, base frame [m^2].
  void picture(const ros::Time& stamp, const lie::SE3& X_BT,
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

  /// The arm cannot be commanded: refuses or aborts the goal, and ends a hold.
  void abandon(const std::string& reason) {
    if (candidate_) {
      reject(*candidate_, {Result::NOT_ENABLED, reason});
      discardCandidate();
    }
    if (run_) end({Result::NOT_ENABLED, reason});
    endHold();
  }

 private:
  using Server = actionlib::ActionServer<FollowTipPathAction>;
  using Handle = Server::GoalHandle;

  /// An accepted goal.
  struct Run {
    Handle handle;
    PathGoal goal;
    GoalWatch watch;
    bool follows = false;  ///< the arm follows its path
  };

  void onGoal(Handle handle) {
    const auto goal = handle.getGoal();
    if (const auto refusal = refusalOf(*goal, scene_.safety.rules.target_timeout)) {
      return reject(handle, *refusal);
    }
    const std::string& frame = goal->path.header.frame_id;
    const auto found = frames_.find(frame);
    const auto* const place = std::get_if<FrameLookup::Place>(&found);
    if (place == nullptr || !place->fixed) {
      return reject(
          handle,
          {Result::INVALID_GOAL,
           place == nullptr ? "the path: " + std::get<control::Refusal>(found).message
                            : "the frame '" + basics::quoted(frame) + "' moves relative to '" +
                                  frames_.baseFrame() +
                                  "'; send the path in a frame with a static transform to it"});
    }
    if (candidate_) {
      candidate_->setCanceled(resultOf(
          {Result::SUCCESSFUL,
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

  void onCancel(Handle handle) {
    if (candidate_ && *candidate_ == handle) {
      handle.setCanceled(resultOf({Result::SUCCESSFUL, "cancelled before it began"}));
      discardCandidate();
    } else if (run_ && run_->handle == handle) {
      cancel("cancelled: the arm stays where it was wanted");
    }
  }

  static void reject(Handle& handle, const GoalEnding& refusal) {
    logWarning("follow_tip_path: %s", refusal.message.c_str());
    handle.setRejected(resultOf(refusal), refusal.message);
  }

  void discardCandidate() {
    checker_.discard();
    client_.next().release();
    candidate_.reset();
  }

  void takeCandidate() {
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

  void begin(double time) {
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

  // With copies of the present state, since the check runs in another thread.
  PathCheck pathCheck() const {
    Eigen::VectorXd slew(scene_.arm.actuatorCount());
    for (int i = 0; i < scene_.arm.actuatorCount(); ++i) {
      slew[i] = scene_.safety.channels[static_cast<std::size_t>(i)].slew;
    }
    const Eigen::VectorXd start =
        scene_.arm.clamped(link_.setPoint().value_or(scene_.arm.inputAt(0)));
    statics::InverseOptions options;
    options.preference = scene_.follow.preference;
    return [slew, start, options, model = scene_.model, correction = loop_.tracker().correction()](
               const control::TipPath& path, double tolerance,
               const std::atomic<bool>& stop) -> std::string {
      statics::InverseSolver solver(model, options);
      solver.correct(correction);
      const auto refusal = follow::checkPath(path, model.arm(), solver, start, {tolerance, slew},
                                             [&stop] { return stop.load(); });
      return refusal ? refusal->reason : std::string();
    };
  }

  // What is wrong with the arm comes before what it brought about.
  void endWatched(GoalEnding ending) {
    if (ending.code != Result::SUCCESSFUL)
      ending.message = ledBySuspect(*suspects_, ending.message);
    end(ending);
  }

  void end(const GoalEnding& ending) {
    const Result result = resultOfRun(ending);
    const bool done = ending.code == Result::SUCCESSFUL;
    logLine(done ? ros::console::levels::Info : ros::console::levels::Warn, "follow_tip_path: %s",
            ending.message.c_str());
    done ? run_->handle.setSucceeded(result, ending.message)
         : run_->handle.setAborted(result, ending.message);
    leave();
  }

  void cancel(const std::string& reason) {
    run_->handle.setCanceled(resultOfRun({Result::SUCCESSFUL, reason}), reason);
    leave();
  }

  Result resultOfRun(const GoalEnding& ending) const {
    const bool ignored = run_->follows && run_->goal.ignore_contacts;
    return resultOf(ending, run_->watch.figures(),
                    ignored ? loop_.quiet() : estimation::QuietScore{});
  }

  // The last position is held if the arm was moved there.
  void leave() {
    loop_.ignoreContacts(false);
    const double longest = longestHold();
    const double usual =
        std::isinf(longest) ? longest : std::min(longest, scene_.safety.rules.target_timeout);
    hold_time_ = run_->goal.hold.value_or(usual);
    if (run_->follows) hold_since_ = ros::SteadyTime::now();
    run_.reset();
    client_.present().release();
  }

  bool isHeld() const {
    return hold_since_ && (ros::SteadyTime::now() - *hold_since_).toSec() < hold_time_;
  }
  /// Longest time for which a place may be held [s].
  double longestHold() const {
    const bool simulated = scene_.regulator && !regulator::isHardware(*scene_.regulator);
    return simulated ? std::numeric_limits<double>::infinity() : kLongestHold;
  }

  const io::Scene& scene_;
  const FrameLookup& frames_;
  LoopTargets& targets_;
  follow::VisualServo& loop_;
  const CommandLink& link_;
  const std::optional<procedures::SuspectWatch>& suspects_;
  std::optional<Handle> candidate_;  ///< its goal is being checked
  PathChecker checker_;
  std::optional<Run> run_;
  std::optional<ros::SteadyTime> hold_since_;
  double hold_time_ = 0.0;                      ///< [s]
  GoalClient<FollowTipPathActionGoal> client_;  ///< of the running goal and of the candidate
  FaultGuard guard_{"a goal of follow_tip_path"};
  std::unique_ptr<Server> server_;  ///< last: its callbacks use all of the above
};

using follow::LoopState;

constexpr double kFreshReading = 1.0;  // pressures silent for longer end a command [s]

ros::console::Level levelOf(LoopState state, LoopState before) {
  if (state == LoopState::kDiverging) return ros::console::levels::Error;
  const bool lost = state == LoopState::kCoasting || state == LoopState::kDoubtful ||
                    (state == LoopState::kOpen && before != LoopState::kIdle);
  return lost ? ros::console::levels::Warn : ros::console::levels::Info;
}

/// Private parameters of visual_servo.
struct VisualServoOptions {
  ParameterReader reader{ros::NodeHandle("~")};
  std::string scene = reader.file("scene", "config/scenes", ".yaml");  ///< as pressure_command's
  double rate = reader.number("rate", 50.0, {1.0, 1000.0});  ///< of loop_status and estimate [Hz]
  double draw_rate = reader.number("draw_rate", 20.0, {0.1, 100.0});  ///< of the markers [Hz]
  std::string frame_prefix = reader.frame("frame_prefix", "");
  bool handle = reader.flag("handle", true);  ///< show the interactive marker
  std::string scene_folder = reader.folder("scene_folder", defaultFolder());  ///< likewise

  VisualServoOptions() { reader.finish(); }
};

/// Brings the tip where it is wanted by what the camera sees: a follow::VisualServo as one
/// commander of pressure_command, the node visual_servo of docs/nodes.md. Parameters:
/// VisualServoOptions.
///
/// One turn per pressure_measured, whose stamp is the turn's time; the node has no timer of its own
/// that moves the arm. Whoever sends no target for safety.target_timeout, by a steady clock, lets
/// go of the arm, which then vents, unless somebody else commands it. Where somebody else asks
/// pressure_command for rest, goals, holds and targets end. After the hold of a goal, and where the
/// node is asked to end, it asks pressure_command for rest.
///
/// All of it runs in the main thread, except that the paths of goals are checked in others.
class VisualServoNode : public Node {
 public:
  VisualServoNode() {
    logInfo("%s: closes the loop of %d actuators over vision", scene_.name.c_str(),
            scene_.arm.actuatorCount());
  }

  /// Not while the arm follows the loop: it is to be brought to rest first.
  bool mayEnd() const override { return !link_.isBusy(); }

 private:
  using Self = VisualServoNode;
  using Trigger = std_srvs::Trigger;
  using SetBool = std_srvs::SetBool;

  void onReading(const PressureArrayConstPtr& message) {
    if (EndRequest::made()) return;
    const auto checked = control::checkReading(scene_.arm, message->name, message->pressure);
    if (const auto* refusal = std::get_if<control::Refusal>(&checked)) {
      if (!bad_readings_.add()) return;
      logWarning("a pressure_measured was dropped (%lu so far): %s", bad_readings_.total(),
                 refusal->message.c_str());
      return;
    }
    last_reading_ = ros::SteadyTime::now();
    const ros::Time& stamp = message->header.stamp;
    turn(stamp.isZero() ? ros::Time::now() : stamp, std::get<Eigen::VectorXd>(checked));
  }

  void onMeasured(const ArmShapeConstPtr& message) {
    const auto shape = fromMsg(*message, scene_.arm, frames_.baseFrame());
    const auto covariance = covarianceOf(*message, scene_.arm.sectionCount());
    for (const auto* refusal :
         {std::get_if<control::Refusal>(&shape), std::get_if<control::Refusal>(&covariance)}) {
      if (refusal == nullptr) continue;
      pictures_.sawForeign(refusal->message);
      return;
    }
    matcher_.add({message->header.stamp, std::get<model::Shape>(shape),
                  std::get<Eigen::MatrixXd>(covariance)},
                 ros::SteadyTime::now().toSec());
    look();
  }

  void onVision(const VisionStatusConstPtr& status) { moved_ = status->base_moved; }

  void onTags(const TagDetectionsConstPtr& detections) {
    if (!scene_.tags) return;
    matcher_.addTags(detections->header.stamp, fittedTags(*detections, *scene_.tags),
                     ros::SteadyTime::now().toSec());
    look();
  }

  /// Takes the measured shapes that wait for their tags no longer.
  void look() {
    while (const auto seen = matcher_.take(ros::SteadyTime::now().toSec())) onSeen(*seen);
  }

  void onSeen(const SeenArm& seen) {
    // Simulated time may reach this node later than the readings that it stamps.
    const double now = std::max(ros::Time::now().toSec(), stamp_.toSec());
    const estimation::Observation observation =
        loop_.picture(seen.stamp.toSec(), now, seen.shape.twists(), seen.covariance, seen.tags);
    pictures_.saw(now, secondsBetween(stamp_, seen.stamp), observation, loop_.tracker(),
                  seen.tags.has_value());
    if (suspects_->see(loop_, observation)) tellSuspect();
    if (!observation.accepted()) return;
    last_picture_ = seen.stamp;
    publisher_.publishLoad(seen.stamp, moved_);
    if (action_.runs()) {
      lie::SE3 tip = model::tipPose(seen.shape);
      tip.translation += loop_.load().tip_beyond_fit;
      const auto prediction = loop_.prediction();
      action_.picture(
          seen.stamp, tip,
          prediction ? prediction->tip_covariance : Eigen::Matrix3d(Eigen::Matrix3d::Zero()));
    }
  }

  bool onCloseLoop(const SetBool::Request& request, SetBool::Response& response) {
    closes_ = request.data;
    loop_.close(closes_);
    response.success = true;
    response.message = closes_ ? "the loop closes when the arm is seen"
                               : "the loop stays open: the correction fades out within a second";
    logInfo("close_loop: %s", response.message.c_str());
    return true;
  }

  bool onReset(const Trigger::Request&, Trigger::Response& response) {
    loop_.reset();
    loop_.distrustModel(false);
    suspects_.emplace(scene_);
    publisher_.publishLoad(stamp_, moved_);
    response.success = true;
    response.message =
        "what was learnt from pictures is cleared: the correction fades out within a second";
    logInfo("reset: %s", response.message.c_str());
    return true;
  }

  void onDraw(const ros::SteadyTimerEvent&) {
    const bool measures = !last_reading_.isZero() &&
                          ros::SteadyTime::now() - last_reading_ < ros::WallDuration(kFreshReading);
    if (!measures) {
      giveUp("no pressure_measured is received; is the regulator's node running?");
      letGo();
      publisher_.clear();
    }
    if (EndRequest::made()) {
      giveUp("the node of the loop is shutting down");
      link_.rest();
      letGo();
    }
    link_.restIfDue();
    publisher_.draw();
  }

  void onDiagnose(const ros::SteadyTimerEvent&) {
    diagnostics_.publish(ros::this_node::getName(), scene_,
                         {pictures_.loop(loop_, reason(), suspects()), pictures_.correction(loop_),
                          targets_.admission().status()});
  }

  void adopt(io::Scene next) {
    next = requirePneumatic(std::move(next));
    requireSameRig(scene_, next);
    basics::require(!action_.runs() && !targets_.target(),
                    "the loop commands the arm; cancel its goal, or send it no target for ",
                    scene_.safety.rules.target_timeout, " s, and reload again");
    follow::VisualServo loop(next.model, procedures::loopConfigOf(next));
    loop.close(closes_);
    if (action_.wants()) {  // the last place of a goal, which is the old model's
      action_.endHold();
      link_.rest();
    }
    scene_ = std::move(next);
    loop_ = std::move(loop);
    suspects_.emplace(scene_);
    targets_.admission().adopt();
    matcher_.clear();
    publisher_.publishLoad(stamp_, moved_);
  }

  void turn(const ros::Time& stamp, const Eigen::VectorXd& reading) {
    look();
    const LoopState before = loop_.state();
    stamp_ = stamp;
    const double time = stamp.toSec();
    loop_.enable(link_.follows());
    if (link_.takeEnabling()) targets_.enabled();
    if (const std::string other = diagnostics_.otherScene(scene_); !other.empty()) {
      giveUp(other);
      link_.rest();
    }
    action_.prepare(time);
    aim();
    const follow::Turn& turn = loop_.reading(time, link_.setPoint().value_or(reading), reading);
    command(turn);
    if (turn.commands) action_.watch(time, turn);
    tellState(before);
    publisher_.publish(view());
  }

  void aim() {
    const auto& target = targets_.target();
    const bool changed = targets_.takeChange();
    if (target && action_.runs()) {
      targets_.refuse({control::Fault::kOtherCommander,
                       "a goal of ~follow_tip_path commands the arm; cancel it first"});
    } else if (target && link_.follows() && (changed || !loop_.hasTarget())) {
      action_.endHold();
      loop_.aimAt(*target);
    }
    if (isWanted()) return;
    if (action_.takeEndOfHold()) link_.rest();
    letGo();
  }

  void command(const follow::Turn& turn) {
    if (turn.commands) {
      link_.send(turn.pressure);
      targets_.answer({turn.status, turn.residual, turn.position_error, turn.limits});
      return;
    }
    if (!isWanted()) return;
    if (const auto refusal = link_.refusal()) {
      targets_.refuse(*refusal);
      letGo();
    } else {
      link_.ask();
    }
  }

  bool isWanted() { return action_.wants() || targets_.target().has_value(); }

  void letGo() {
    loop_.release();
    link_.fallSilent();
  }

  void giveUp(const std::string& reason) {
    targets_.refuse({control::Fault::kNotEnabled, reason});
    action_.abandon(reason);
  }

  LoopPublisher::View view() {
    return {stamp_, last_picture_, action_.wants() ? names::kFollowTipPath : targets_.commander(),
            reason()};
  }

  // A camera that has moved comes first: through it the arm seems to move otherwise.
  std::string suspects() const {
    std::string out = moved_.empty() ? "" : "camera_moved: " + moved_;
    for (const std::string& one : procedures::textsOf(suspects_->suspects())) {
      out += (out.empty() ? "" : "; ") + one;
    }
    return out;
  }
  // Once, not for each search that finds it again.
  void tellSuspect() {
    const std::vector<estimation::Suspect>& found = suspects_->suspects();
    const std::string first = found.empty() ? "" : found.front().cause + found.front().where;
    if (std::exchange(suspect_, first) == first || first.empty()) return;
    logWarning("%s", procedures::textsOf(found).front().c_str());
  }

  std::string reason() { return ledBySuspect(*suspects_, stateReason()); }

  std::string stateReason() {
    const LoopState state = loop_.state();
    const bool unseen = state == LoopState::kCoasting || (state == LoopState::kOpen && closes_);
    if (loop_.turn().held && unseen) {
      return "contact with the arm, and no picture of it since then: path and correction are held "
             "until the arm is seen to be free; " +
             std::string(kCheckVision);
    }
    if (unseen && !pictures_.wrongStamp().empty()) return pictures_.wrongStamp();
    switch (state) {
      case LoopState::kIdle:
        if (!targets_.refusal().empty()) return "waits for the arm: " + targets_.refusal();
        return isWanted() ? "waits for the arm: " + link_.whyNot() : "the loop has no target";
      case LoopState::kOpen:
        if (!closes_) return "kept open by ~close_loop";
        return std::string(last_picture_ ? "the arm is not seen; "
                                         : "no message on measured was used yet; ") +
               kCheckVision + ", and the refused pictures in the diagnostics";
      case LoopState::kClosed:
        return closedReason();
      case LoopState::kCoasting:
        return std::string("the arm is not seen for the moment: the correction is held; ") +
               kCheckVision;
      case LoopState::kYielding:
        return contactWords(*suspects_).what + ": path and correction are held; " +
               contactWords(*suspects_).remedy;
      case LoopState::kDoubtful:
        return "the correction is held, since " + procedures::driftText(loop_.drift());
      case LoopState::kDiverging:
        break;
    }
    return "the tip moves away from a target within the model's reach: the arm does not bend "
           "as its model does; check for swapped hoses, tags and signs, then call ~reset";
  }

  // Forces and budget are doubts: a camera that has moved looks like them.
  std::string closedReason() const {
    const std::string out = "follows the measured shape";
    if (!moved_.empty()) return out + ", but " + moved_;
    if (loop_.load().contact) {
      return out + ", which shows contact (external_load): a load, or the camera or base has moved";
    }
    if (loop_.budget() && loop_.budget()->state == estimation::BudgetState::kOutside) {
      return out +
             ", which the calibration does not explain (error_budget): check arm, load, camera "
             "and base, then calibrate again";
    }
    return out;
  }

  void tellState(LoopState before) {
    const LoopState state = loop_.state();
    if (state == before) return;
    logLine(levelOf(state, before), "%s: %s", follow::nameOf(state), reason().c_str());
  }

  const VisualServoOptions options_{};
  io::Scene scene_ = requirePneumatic(io::loadScene(options_.scene));
  follow::VisualServo loop_{scene_.model, procedures::loopConfigOf(scene_)};
  std::optional<procedures::SuspectWatch> suspects_{scene_};
  std::string suspect_;  ///< the first one that was told
  bool closes_ = true;
  ros::Time stamp_;                        ///< of the last turn
  ros::SteadyTime last_reading_;           ///< zero: none yet
  std::optional<ros::Time> last_picture_;  ///< that the loop used
  std::string moved_;  ///< where camera or base are not where the scene says: VisionStatus
  FaultCount bad_readings_;

  ros::NodeHandle node_, private_node_{"~"};
  FrameLookup frames_{node_, options_.frame_prefix + names::kBaseFrame};
  LoopDiagnostics pictures_;
  TagMatcher matcher_;
  CommandLink link_{node_, scene_};
  LoopTargets targets_{node_, scene_, frames_};
  LoopPublisher publisher_{
      node_,
      scene_,
      loop_,
      pictures_,
      suspects_,
      frames_.baseFrame(),
      options_.rate,
      options_.draw_rate,
      options_.handle ? [this](const TipTarget& target) { targets_.takeFromHandle(target); }
                      : TipHandle::OnTarget()};
  FollowAction action_{private_node_, scene_, frames_, targets_, loop_, link_, suspects_};
  DiagnosticsPublisher diagnostics_{node_};
  const ros::Subscriber readings_ =
      listen(node_, names::kPressureMeasured, 10, &Self::onReading, this);
  const ros::Subscriber measured_ = listen(node_, names::kMeasured, 10, &Self::onMeasured, this);
  const ros::Subscriber tags_ = listen(node_, names::kTagDetections, 10, &Self::onTags, this);
  const ros::Subscriber vision_ = listen(node_, names::kVisionStatus, 10, &Self::onVision, this);
  const ros::ServiceServer close_ =
      serve(private_node_, names::kCloseLoop, &Self::onCloseLoop, this);
  const ros::ServiceServer reset_ = serve(private_node_, names::kReset, &Self::onReset, this);
  ReloadServer reload_{private_node_, options_.scene, options_.scene_folder,
                       [this](io::Scene next) { adopt(std::move(next)); }};
  const ros::SteadyTimer draw_ =
      repeat(node_, "the drawing", 1.0 / options_.draw_rate, &Self::onDraw, this);
  const ros::SteadyTimer diagnose_ = repeat(node_, "the diagnostics", 1.0, &Self::onDiagnose, this);
};

}  // namespace

std::unique_ptr<Node> makeVisualServo() { return std::make_unique<VisualServoNode>(); }

}  // namespace helix_arm::ros_bridge
