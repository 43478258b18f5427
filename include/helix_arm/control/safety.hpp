#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <limits>
#include <optional>
#include <string>
#include <vector>

#include "helix_arm/control/channel_watch.hpp"
#include "helix_arm/control/valve_orders.hpp"
#include "helix_arm/model/arm.hpp"

namespace helix_arm::control {

/// Where the pressure path stands.
enum class SafetyState : std::uint8_t {
  kDisabled,  ///< vents; nobody has enabled it yet
  kEnabled,   ///< follows targets
  kFault,     ///< does what each channel does in a fault, until no pressure stands
  kVented,    ///< after a fault: vents, and no pressure stands
};

/// What took the arm out of kEnabled, or out of kDisabled and kVented where pressure stood.
enum class SafetyCause : std::uint8_t {
  kNone,
  kVentRequested,  ///< somebody asked for it
  kEmergencyStop,
  kStaleTarget,    ///< no target for SafetyRules::target_timeout
  kStaleReading,   ///< no reading of a channel for SafetyRules::reading_timeout
  kRegulatorLost,  ///< its link is down
  kOverLimit,      ///< a pressure above limit and margin for longer than a spike
  kLowSupply,
  kNotFollowing,  ///< a pressure does not come to its set point within the time that it has
  kLeak,          ///< a pressure falls while its set point stands: a burst muscle, a loose tube
  kNotVenting,    ///< pressure stands where all was vented
  kGuardLost,     ///< nobody would vent the arm if its process were killed
};
inline constexpr int kSafetyCauseCount = 12;

/// Who would vent the arm where the process that moves it were killed.
enum class Guard : std::uint8_t {
  kNotNeeded,    ///< nobody: no hardware, or not this process's
  kStarting,     ///< somebody who has not answered yet
  kStands,       ///< somebody who answers
  kStandsStill,  ///< somebody who answers no longer
  kEnded,        ///< nobody any more
};
/// Whether nobody answers, nor will.
constexpr bool isGone(Guard guard) { return guard >= Guard::kStandsStill; }

/// What a channel does in a fault that is not its own danger.
enum class FaultAction : std::uint8_t {
  kVent,
  kHold,   ///< keeps its set point for SafetyRules::hold_time, then vents
  kClose,  ///< closes its valves for SafetyRules::hold_time, then vents
};
/// All of them. A new action belongs here, too.
inline constexpr FaultAction kFaultActions[] = {FaultAction::kVent, FaultAction::kHold,
                                                FaultAction::kClose};

/// "disabled", "enabled", "fault" or "vented".
const char* nameOf(SafetyState state);
/// "none", "vent_requested", "emergency_stop", "stale_target", ...
const char* nameOf(SafetyCause cause);
/// "vent", "hold" or "close".
const char* nameOf(FaultAction action);

/// The rules of one channel.
struct ChannelRules {
  std::string name;                                       ///< the actuator's
  model::Range limits;                                    ///< of what is commanded, gauge [Pa]
  double slew = std::numeric_limits<double>::infinity();  ///< of what is commanded, > 0 [Pa/s]
  FaultAction action = FaultAction::kVent;
};

/// The rules of the whole pressure path. Timers of several readings or turns: a spike, or a channel
/// that is slow, is no fault.
struct SafetyRules {
  /// Longest silence of the commander, > 0; infinite: any [s].
  double target_timeout = 1.0;
  double reading_timeout = 0.5;  ///< longest silence of the regulator, > 0 [s]
  double trip_margin = 3e4;      ///< above the limits before a reading counts as over, >= 0 [Pa]
  double spike_time = 0.1;       ///< how long what is wrong may last before it is a fault, >= 0 [s]
  std::optional<double> min_supply;  ///< least supply pressure, gauge [Pa]; absent: not watched
  /// How far a reading may be from what a first-order lag of `time_constant` makes of the set
  /// point, > 0 [Pa], and for how long, > 0 [s].
  double follow_tolerance = 4e4;
  double follow_time = 1.0;
  double time_constant = 0.2;  ///< of a healthy channel, > 0 [s]
  /// How far a reading may fall below a set point that stands and that it had reached, > 0 [Pa].
  double leak_drop = 2.5e4;
  double hold_time = 10.0;  ///< of FaultAction::kHold and kClose, >= 0 [s]
  double vented_below =
      1.5e4;               ///< a reading within this of the atmosphere is no pressure, > 0 [Pa]
  double vent_time = 3.0;  ///< a channel that vents is to be empty by then, > 0 [s]

  /// @throws std::invalid_argument naming the value and its rule.
  void validate() const;
};

/// The first rule that is looser in `next` than in these: what would let more pressure stand, or
/// longer. Names it with both values; empty: none is. The channels are the same ones.
std::string loosened(const std::vector<ChannelRules>& channels, const SafetyRules& rules,
                     const std::vector<ChannelRules>& next_channels, const SafetyRules& next);

/// How the pressure path came to where it stands.
struct SafetyReport {
  SafetyState state = SafetyState::kDisabled;
  SafetyCause cause =
      SafetyCause::kNone;  ///< of the newest fault; the first one where several came
  int channel = -1;        ///< of the cause, where it is one channel's
  double value = 0;        ///< what was seen of the cause [Pa] or [s]
  double limit = 0;        ///< and what its rule allows
  double since = 0;        ///< when it came to this state [s]
  bool stopped = false;    ///< the emergency stop is engaged
  /// Since it was enabled nothing has come but what passes by itself: silence of the commander or
  /// of the regulator, a lost link. Nobody has stopped it or asked for a vent.
  bool passing = true;
  bool vent_overdue = false;  ///< pressure still stands after vent_time
  std::uint64_t changes = 0;  ///< of anything above but `value`, and of the link, so far
};

/// Stands between whoever commands and the regulator: decides, turn by turn, what each channel
/// does.
///
/// Whatever happens, a channel that regulates has a set point within its limits, or on its way to
/// them from the atmosphere, which moves no faster than its slew; and after a fault every channel
/// vents, at once or, where its action is hold or close, after hold_time. The emergency stop, a
/// requested vent, and what is itself a danger (over limit, leak, not venting) vent every channel
/// at once.
///
/// All times are of one steady clock [s] and must not go back: an earlier one counts as the last.
/// Nothing after the constructor allocates, locks or throws, but for reason(), refusal(), enable()
/// and adopt().
class SafetyCore {
 public:
  /// Vents, disabled.
  /// @throws std::invalid_argument naming the channel or rule that breaks the contract.
  SafetyCore(std::vector<ChannelRules> channels, const SafetyRules& rules);

  /// Why it cannot be enabled now; empty when it can: from kDisabled and kVented, with the
  /// emergency stop released, a guard that stands, fresh readings that show no pressure, a
  /// regulator that answers and its supply.
  std::string refusal(double now) const;
  /// Enables, with set points that go from the atmosphere to the limits that are nearest to it, or
  /// says why not. The watchdog of targets begins with the first one.
  /// @return as refusal().
  std::string enable(double now);
  /// Whether a target alone may enable it, where the user allows that at all: before it was enabled
  /// for the first time, and after what has passed by itself (SafetyReport::passing).
  bool mayEnableItself() const;
  /// Vents all; ends in kVented. While disabled or vented it only bars mayEnableItself().
  void vent(double now);
  /// Engaged: vents all, latched. Released: nothing moves, but it can be enabled again.
  void emergencyStop(double now, bool engaged);

  /// What to go to from now on: (channels) gauge [Pa]; clamped to the limits, an entry that is not
  /// finite leaves its channel as it is. Without effect, and false, unless enabled.
  bool target(double now, const Eigen::Ref<const Eigen::VectorXd>& pressure);
  /// What the regulator reads: (channels) gauge [Pa], an entry that is not finite is none; and the
  /// supply's pressure, NaN where it is not measured.
  /// @param age  since it was asked, >= 0 [s]: so much of the silence that is allowed is over.
  void measured(double now, const Eigen::Ref<const Eigen::VectorXd>& pressure,
                double supply = std::numeric_limits<double>::quiet_NaN(), double age = 0);
  /// Whether the regulator's link is up; it counts as up until told otherwise.
  void linked(double now, bool up);
  bool linked() const { return link_up_; }
  /// Who guards; nobody needs to until told otherwise. Where somebody needs to it is enabled only
  /// while he stands, and vents all when he no longer does.
  void guarded(double now, Guard guard);

  /// Lets time pass up to now, and says what to do until the next turn.
  const ValveOrders& advance(double now);

  /// Other rules for the same channels from now on; state, orders and timers go on.
  /// @throws std::invalid_argument as the constructor, and where the channels are others or one
  /// regulates at, or on its way to, what its new limits do not allow; the old rules stay.
  void adopt(std::vector<ChannelRules> channels, const SafetyRules& rules);

  const ValveOrders& orders() const { return orders_; }  ///< of the last turn
  const SafetyReport& report() const { return report_; }
  SafetyState state() const { return report_.state; }
  /// (channels) where the set points go [Pa].
  const Eigen::VectorXd& goal() const { return goal_; }
  /// Newest finite readings (channels), NaN before the first [Pa].
  const Eigen::VectorXd& reading() const { return reading_; }
  const std::vector<ChannelRules>& channels() const { return channels_; }
  const SafetyRules& rules() const { return rules_; }
  /// One line: the state, its culprit with value and rule, and what to do about it.
  std::string reason() const;

 private:
  int count() const { return static_cast<int>(channels_.size()); }
  bool isVented() const;  // in kDisabled or kVented
  void pass(double now);
  double startOf(int i) const;
  void setState(SafetyState state, SafetyCause cause, int channel, double value, double limit);
  void raise(SafetyCause cause, int channel, double value, double limit);
  void release(int channel);
  void watchTimes();
  void watchReadings();
  void regulate(double dt);
  void endHold();
  void endFault();
  bool allVentAndEmpty() const;
  std::string guardRefusal() const;
  std::string supplyRefusal(double now) const;
  std::string channelRefusal(int i, double now) const;
  std::string causeText() const;
  std::string actionText() const;
  std::string ventText() const;
  std::string overdueText() const;

  std::vector<ChannelRules> channels_;
  SafetyRules rules_;
  SafetyReport report_;
  ValveOrders orders_;
  Eigen::VectorXd goal_;
  Eigen::VectorXd reading_;
  std::vector<ChannelWatch> watch_;  // (channels)
  std::vector<double> vents_since_;  // (channels)
  SpikeFilter low_supply_;
  double supply_ = std::numeric_limits<double>::quiet_NaN();
  double supply_at_ = -std::numeric_limits<double>::infinity();
  double target_at_ = std::numeric_limits<double>::infinity();  // since enabled; infinite: none
  double now_ = 0;
  double turn_at_ = 0;
  bool started_ = false;
  bool link_up_ = true;
  Guard guard_ = Guard::kNotNeeded;
};

}  // namespace helix_arm::control
