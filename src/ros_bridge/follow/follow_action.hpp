#pragma once

#include <list>
#include <memory>
#include <optional>
#include <string>
#include <utility>

#include <actionlib/server/action_server.h>
#include <boost/weak_ptr.hpp>
#include <ros/node_handle.h>
#include <ros/time.h>

#include "command_link.hpp"
#include "helix_arm/FollowTipPathAction.h"
#include "helix_arm/follow/visual_servo.hpp"
#include "helix_arm/io/scene.hpp"
#include "loop_targets.hpp"
#include "path_goal.hpp"
#include "procedures/suspect_watch.hpp"
#include "ros_bridge/common/arm_frames.hpp"
#include "ros_bridge/common/client_watch.hpp"
#include "ros_bridge/common/diagnostics.hpp"
#include "ros_bridge/common/guarded_callbacks.hpp"

namespace helix_arm::ros_bridge {

/// Watches the node that sent a goal of follow_tip_path. For the thread of the node's
/// callback queue.
///
/// actionlib does not tell who sent a goal: this hears the same messages. It is made before the
/// server of the action with the same node handle, so that it hears each of them first.
class GoalClient {
 public:
  GoalClient(ros::NodeHandle& node, const std::string& action) {
    constexpr int kQueue = 50;  // that of actionlib
    subscriber_ =
        listen<FollowTipPathActionGoal>(node, action + "/goal", kQueue, [this](const auto& event) {
          senders_.remove_if([](const auto& sender) { return sender.first.expired(); });
          senders_.emplace_back(event.getConstMessage(), event.getPublisherName());
        });
  }

  /// Watches the sender of the next goal, which the server has handed out and not copied, beside
  /// that of the present one: a goal may be checked for long before it begins.
  void watchNext(const FollowTipPathGoal& goal) {
    for (const auto& [message, sender] : senders_) {
      const auto held = message.lock();
      if (held && &held->goal == &goal) return next().watch(sender);
    }
    next().watch("");
  }
  /// The next goal becomes the present one.
  void beginNext() {
    present().release();
    present_ = 1 - present_;
  }

  ClientWatch& present() { return watches_[present_]; }
  ClientWatch& next() { return watches_[1 - present_]; }

 private:
  /// Senders of the goals that somebody still has.
  std::list<std::pair<boost::weak_ptr<const FollowTipPathActionGoal>, std::string>> senders_;
  ClientWatch watches_[2];
  int present_ = 0;
  ros::Subscriber subscriber_;
};

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
               const std::optional<procedures::SuspectWatch>& suspects);

  /// A goal runs, or waits for its start or for the arm.
  bool runs() const { return run_.has_value(); }
  /// The arm is to be commanded: a goal runs, or its last place is held.
  bool wants() const { return run_.has_value() || isHeld(); }
  /// Whether a hold has run out since the last call.
  bool takeEndOfHold() { return !wants() && std::exchange(hold_since_, std::nullopt); }
  /// No longer holds the last place of a goal: another command has come.
  void endHold() { hold_since_.reset(); }

  /// Before each turn of the loop: takes goals up and begins paths. @param time  of the turn [s].
  void prepare(double time);

  /// After a turn in which the loop commands.
  void watch(double time, const follow::Turn& turn);

  /// After a picture that the loop used.
  /// @param X_BT            measured tip.
  /// @param tip_covariance  of the predicted tip's position, base frame [m^2].
  void picture(const ros::Time& stamp, const lie::SE3& X_BT, const Eigen::Matrix3d& tip_covariance);

  /// The arm cannot be commanded: refuses or aborts the goal, and ends a hold.
  void abandon(const std::string& reason);

 private:
  using Server = actionlib::ActionServer<FollowTipPathAction>;
  using Handle = Server::GoalHandle;
  using Result = FollowTipPathResult;

  /// An accepted goal.
  struct Run {
    Handle handle;
    PathGoal goal;
    GoalWatch watch;
    bool follows = false;  ///< the arm follows its path
  };
  static Result resultOf(const GoalEnding& ending, const GoalFigures& figures = {},
                         const estimation::QuietScore& quiet = {});

  /// Reaction that a goal requests; the scene's by default.
  static follow::OnContact reactionTo(std::uint8_t on_contact, follow::OnContact usual);
  void onGoal(Handle handle);
  void onCancel(Handle handle);
  static void reject(Handle& handle, const GoalEnding& refusal);
  void discardCandidate();
  void takeCandidate();
  void begin(double time);

  // The check has copies of the present state, since it runs in another thread.
  PathCheck pathCheck() const;

  // A suspected cause is named before the ending that it brought about.
  void endWatched(GoalEnding ending);
  void end(const GoalEnding& ending);
  void cancel(const std::string& reason);
  Result resultOfRun(const GoalEnding& ending) const;

  // The last position is held if the arm was moved there.
  void leave();
  bool isHeld() const;
  /// Longest time for which a place may be held [s].
  double longestHold() const;

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
  double hold_time_ = 0.0;  ///< [s]
  GoalClient client_;       ///< of the running goal and of the candidate
  FaultGuard guard_{"a goal of follow_tip_path"};
  std::unique_ptr<Server> server_;  ///< last: its callbacks use all of the above
};

}  // namespace helix_arm::ros_bridge
