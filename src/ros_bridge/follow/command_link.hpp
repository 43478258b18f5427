#pragma once

#include <Eigen/Core>
#include <optional>
#include <string>
#include <utility>

#include <ros/node_handle.h>
#include <ros/time.h>

#include "helix_arm/PressureArray.h"
#include "helix_arm/SafetyState.h"
#include "helix_arm/TargetStatus.h"
#include "helix_arm/control/target_check.hpp"
#include "helix_arm/io/scene.hpp"
#include "ros_bridge/common/diagnostics.hpp"
#include "ros_bridge/common/rest_request.hpp"

namespace helix_arm::ros_bridge {

/// The loop as one commander of pressure_command among others: sends it pressures, and knows
/// whether the arm follows them.
///
/// Before the arm follows, targets that keep it where it is are sent: they enable a simulated arm,
/// wait for the lease of a commander that yields, and are refused without a motion. Nothing here
/// enables an arm that its targets do not.
///
/// Publishes pressure_target; subscribes to pressure_command, safety_state and target_status. For
/// the thread of the node's callback queue.
class CommandLink {
 public:
  /// @param scene  Its arm and safety rules are used. Kept by reference.
  CommandLink(ros::NodeHandle& node, const io::Scene& scene);

  /// Whether the arm is enabled and follows this node, by the last messages.
  bool follows() const { return speaks_ && accepted_ && enabled_ && isFresh(); }
  /// (n) last pressure_command, in force since about that time; nothing before the first [Pa].
  const std::optional<Eigen::VectorXd>& setPoint() const { return set_point_; }

  /// Sends (n) pressures inside the limits [Pa].
  void send(const Eigen::VectorXd& pressure) { publish(pressure); }
  /// Sends a target that keeps the arm where it is.
  void ask() {
    if (trace_.wasRested()) return;  // until pressure_command knows that this node knows
    publish(scene_.arm.clamped(set_point_ ? *set_point_ : scene_.arm.inputAt(0)));
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
  void restIfDue();
  /// Commands the arm, may do so once it answers, or is to bring it to rest.
  bool isBusy() const { return follows() || rests_ || (speaks_ && trace_.awaitsAnswer()); }

  /// Whether the arm was enabled since the last call.
  bool takeEnabling() { return std::exchange(was_enabled_anew_, false); }

  /// Why the arm does not follow, where waiting does not help; nothing while it follows or may yet.
  std::optional<control::Refusal> refusal() const;
  /// Why the arm does not follow now.
  std::string whyNot() const;

 private:
  void onCommand(const PressureArrayConstPtr& command);
  void onSafety(const SafetyStateConstPtr& state);
  void onStatus(const TargetStatusConstPtr& status);
  bool isFresh() const;
  void publish(const Eigen::VectorXd& pressure);

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

}  // namespace helix_arm::ros_bridge
