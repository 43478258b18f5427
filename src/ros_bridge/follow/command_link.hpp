#pragma once

#include <Eigen/Core>
#include <optional>
#include <string>

#include <ros/node_handle.h>
#include <ros/this_node.h>
#include <ros/time.h>
#include <std_srvs/Trigger.h>

#include "helix_arm/PressureArray.h"
#include "helix_arm/SafetyState.h"
#include "helix_arm/TargetStatus.h"
#include "helix_arm/control/target_check.hpp"
#include "helix_arm/io/scene.hpp"
#include "ros_bridge/common/diagnostics.hpp"
#include "ros_bridge/common/guarded_callbacks.hpp"
#include "ros_bridge/common/run_node.hpp"

namespace helix_arm::ros_bridge {

/// Follows this node's targets and the answers to them. For one thread, or behind one lock.
class CommandTrace {
 public:
  static constexpr double kPatience = 1;  ///< longest wait for the answer to a target [s]

  /// Notes a target of this node.
  void sent(const ros::Time& stamp) {
    last_stamp_ = stamp;
    last_sent_ = ros::SteadyTime::now();
    waits_ = true;
  }
  /// Notes an answer on target_status, to whomever.
  void answered(const TargetStatus& status) {
    const bool accepted = status.outcome != TargetStatus::DROPPED;
    if (status.commander != ros::this_node::getName()) {
      accepted_ = accepted_ && !accepted;
      rested_ = rested_ && !accepted;
      return;
    }
    accepted_ = accepted;
    rested_ = status.fault == control::nameOf(control::Fault::kRested);
    if (status.target_stamp == last_stamp_) waits_ = false;
  }

  /// Whether the arm follows this node: its newest answer accepted a target, no target of another
  /// was accepted since, and the last target has not waited for longer than kPatience.
  bool commands() const { return accepted_ && (!waits_ || awaitsAnswer()); }
  /// Whether the last target may still be answered: it has waited for less than kPatience.
  bool awaitsAnswer() const {
    return waits_ && ros::SteadyTime::now() - last_sent_ <= ros::WallDuration(kPatience);
  }
  /// Whether the newest answer refused a target since somebody else had asked for rest, and no
  /// target of another was accepted since. Once no target of this node is under way, requestRest()
  /// tells pressure_command that it knows: its next target counts.
  bool wasRested() const { return rested_; }

 private:
  ros::Time last_stamp_;
  ros::SteadyTime last_sent_;
  bool waits_ = false;  ///< for the answer to the last target
  bool accepted_ = false;
  bool rested_ = false;
};

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
  void send(const Eigen::VectorXd& pressure);
  /// Sends a target that keeps the arm where it is.
  void ask();
  /// Sends nothing from now on. Without another commander the arm then vents, as after a fault.
  void fallSilent();
  /// Sends nothing from now on, and asks for rest once the last target is answered: the loop is
  /// done. Until it sends again, or another commands the arm.
  void rest();
  /// Asks for the rest that is due, or tells that it knows of the rest that somebody else asked
  /// for: until then it sends nothing. To be called regularly; waits for the answer.
  void restIfDue();
  /// Commands the arm, may do so once it answers, or is to bring it to rest.
  bool isBusy() const { return follows() || rests_ || (speaks_ && trace_.awaitsAnswer()); }

  /// Whether the arm was enabled since the last call.
  bool takeEnabling() { return std::exchange(was_enabled_anew_, false); }

  /// Why the arm does not follow, where waiting does not help; nothing while it follows or may yet.
  std::optional<control::Refusal> refusal() const;
  /// Why the last target was not let through by a zone: the arm stays; empty if it was.
  const std::string& blocked() const { return blocked_; }
  /// Why the arm does not follow now.
  std::string whyNot() const;

 private:
  using Fault = control::Fault;

  static constexpr double kFreshCommand = 1.0;   ///< an older one is of a node that has ended [s]
  static constexpr double kLeasePatience = 1.0;  ///< beyond the lease of another commander [s]
  static constexpr double kLongestLease = 5.0;   ///< that is waited for [s]

  /// Calls pressure_command/rest, waits for the answer and logs it. Without such a service it only
  /// warns: the arm then vents when no targets come.
  static void requestRest();
  void onCommand(const PressureArrayConstPtr& command);
  void onSafety(const SafetyStateConstPtr& state);
  void onStatus(const TargetStatusConstPtr& status);
  bool isFresh() const;

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
  std::string blocked_;
  CommandTrace trace_;
  bool rests_ = false;  ///< rest is asked for when the last target is answered
  FaultCount bad_commands_;

  ros::Publisher target_publisher_;
  ros::Subscriber command_subscriber_, safety_subscriber_, status_subscriber_;
};

}  // namespace helix_arm::ros_bridge
