#pragma once

#include <ros/this_node.h>
#include <ros/time.h>

#include "helix_arm/TargetStatus.h"
#include "helix_arm/control/target_check.hpp"

/// How a commander ends without a fault: it waits until its last target is answered, since a target
/// that comes later would cancel the request, and asks pressure_command to bring the arm to rest.
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

/// Calls pressure_command/rest, waits for the answer and logs it. Without such a service it only
/// warns: the arm then vents when no targets come. Not to be called with a lock held.
void requestRest();

}  // namespace helix_arm::ros_bridge
