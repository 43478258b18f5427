#pragma once

#include <array>
#include <optional>
#include <string>
#include <vector>

#include "ros_bridge/cockpit/cockpit_view.hpp"

namespace helix_arm::ros_bridge {

/// What the cockpit repeats as its target: pressures or a tip. Decides when the repetition ends,
/// so that the cockpit never moves an arm again that vented, or that somebody else has. No clock:
/// times are arguments [s].
///
/// It ends when the arm is no longer enabled, when a target of it is refused for good, when another
/// commander keeps the arm for kPatience, when no target of it is answered for kUnanswered, as if
/// the node that takes them is gone, and when nobody has looked at the cockpit (look()) for kBlind,
/// as if the window hangs.
class HeldGoal {
 public:
  static constexpr double kPatience = 5.0;    ///< [s]
  static constexpr double kBlind = 3.0;       ///< [s]
  static constexpr double kUnanswered = 5.0;  ///< [s]

  void holdPressures(double now, std::vector<double> pressure);     ///< (n) gauge [Pa]
  void holdTip(double now, const std::array<double, 3>& position);  ///< base frame [m]
  /// @param why  shown to the user; may be empty.
  void end(const std::string& why);

  CockpitGoal goal() const { return goal_; }
  const std::vector<double>& pressures() const { return pressures_; }
  const std::array<double, 3>& tip() const { return tip_; }
  const std::string& answer() const { return answer_; }
  bool refused() const { return refused_; }
  bool shortOf() const { return short_of_; }  ///< the target is out of reach

  /// The window is alive.
  void look(double now) { last_look_ = now; }
  /// The state of the arm.
  void noteState(bool enabled, const std::string& reason);
  /// An answer to one of its targets.
  /// @param dropped  whether it was dropped.
  /// @param fault    of a dropped target: other_commander, stale, ...
  void noteAnswer(double now, bool dropped, const std::string& fault, const std::string& message);
  /// The target that was just answered is out of reach; what is nearest to it is commanded.
  void noteShort() { short_of_ = goal_ != CockpitGoal::kNone; }
  /// Ends the goal if a deadline has passed. @return whether a target is to be sent now.
  bool turn(double now);

 private:
  void begin(double now, CockpitGoal goal);

  CockpitGoal goal_ = CockpitGoal::kNone;
  std::vector<double> pressures_;
  std::array<double, 3> tip_{};
  std::string answer_;
  bool refused_ = false, short_of_ = false;
  double last_look_ = 0;
  double answered_at_ = 0;             ///< or begun [s]
  std::optional<double> waits_since_;  ///< for another commander
};

}  // namespace helix_arm::ros_bridge
