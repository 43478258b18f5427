#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <limits>
#include <optional>
#include <string>
#include <vector>

#include "helix_arm/model/arm.hpp"

namespace helix_arm::control {

/// Order for one channel of a pressure regulator.
enum class Valve : unsigned char {
  kVent,      ///< release the pressure to the atmosphere
  kRegulate,  ///< control the pressure to the set point
  kClose,     ///< neither feed nor vent
};

/// Orders for all channels, in the order of the arm's actuators. Initially all channels vent.
struct ValveOrders {
  explicit ValveOrders(int channels)
      : valve(static_cast<std::size_t>(channels), Valve::kVent),
        set_point(Eigen::VectorXd::Zero(channels)) {}

  std::vector<Valve> valve;   ///< (channels)
  Eigen::VectorXd set_point;  ///< (channels) gauge [Pa]; 0 for channels that vent
};

/// State of the pressure path.
enum class SafetyState : std::uint8_t {
  kDisabled,  ///< vents; not enabled yet, or at rest
  kEnabled,   ///< follows targets, or ramps down to rest
  kFault,     ///< performs each channel's fault action until no pressure remains
  kVented,    ///< after a fault: vents, and no pressure remains
};

/// Why the arm left kEnabled, or why it left kDisabled or kVented although pressure was present.
enum class SafetyCause : std::uint8_t {
  kNone,
  kVentRequested,  ///< a user requested it
  kEmergencyStop,
  kStaleTarget,    ///< no target for SafetyRules::target_timeout
  kStaleReading,   ///< no reading of a channel for SafetyRules::reading_timeout
  kRegulatorLost,  ///< the regulator's link is down
  kOverLimit,      ///< a pressure exceeds limit plus margin for longer than a spike
  kLowSupply,
  kNotFollowing,  ///< a pressure does not reach its set point within the permitted time
  kLeak,          ///< a pressure falls at a constant set point: a burst muscle, a loose tube
  kNotVenting,    ///< pressure remains although all channels vent, or have ramped down to rest
  kGuardLost,     ///< no guard would vent the arm if its process were killed
};
inline constexpr int kSafetyCauseCount = 12;

/// The guard that vents the arm if the process that moves it is killed.
enum class Guard : std::uint8_t {
  kNotNeeded,    ///< no guard is needed: no hardware, or the hardware of another process
  kStarting,     ///< the guard has not answered yet
  kStands,       ///< the guard answers
  kStandsStill,  ///< the guard no longer answers
  kEnded,        ///< the guard has ended
};
/// Whether the guard no longer answers and will not answer again.
constexpr bool isGone(Guard guard) { return guard >= Guard::kStandsStill; }

/// Action of a channel in a fault that does not require every channel to vent at once.
enum class FaultAction : std::uint8_t {
  kVent,
  kHold,   ///< keeps its set point for SafetyRules::hold_time, then vents
  kClose,  ///< closes its valves for SafetyRules::hold_time, then vents
};
/// All actions. Add a new action here, too.
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
  std::string name;                                       ///< name of the actuator
  model::Range limits;                                    ///< of the commanded pressure, gauge [Pa]
  double slew = std::numeric_limits<double>::infinity();  ///< maximum rate of the commanded
                                                          ///< pressure, > 0 [Pa/s]
  FaultAction action = FaultAction::kVent;
};

/// The rules of the whole pressure path. The timers span several readings or turns, so a spike or a
/// slow channel is not a fault.
struct SafetyRules {
  /// Longest silence of the commander, > 0; infinite disables the check [s].
  double target_timeout = 1.0;
  double reading_timeout = 0.5;  ///< longest silence of the regulator, > 0 [s]
  double trip_margin = 3e4;      ///< excess over the limits that a reading may have, >= 0 [Pa]
  double spike_time = 0.1;       ///< time that a fault must last to count, >= 0 [s]
  /// Lowest permitted supply pressure, gauge [Pa]; absent: not monitored.
  std::optional<double> min_supply;
  /// Maximum difference between a reading and a first-order lag of the set point with
  /// `time_constant`, > 0 [Pa], and the time for which it may be exceeded, > 0 [s].
  double follow_tolerance = 4e4;
  double follow_time = 1.0;
  double time_constant = 0.2;  ///< of a healthy channel, > 0 [s]
  /// The same where its pressure falls, > 0 [s]; absent: as where it rises.
  std::optional<double> fall_time_constant = std::nullopt;
  /// Maximum drop of a reading below a constant set point held for 1.5 time constants, > 0 [Pa].
  double leak_drop = 2.5e4;
  double hold_time = 10.0;  ///< duration of FaultAction::kHold and kClose, >= 0 [s]
  /// Readings within this of the atmosphere count as no pressure, > 0 [Pa]
  double vented_below = 1.5e4;
  double vent_time = 3.0;  ///< time within which a venting channel must be empty, > 0 [s]

  double fallTimeConstant() const { return fall_time_constant.value_or(time_constant); }
  /// @throws std::invalid_argument naming the value and its rule.
  void validate() const;
};

/// Detects a condition that lasts: it is wrong at every observation for a given time.
class Persistence {
 public:
  /// @param time  duration of an uninterrupted fault that counts as lasting [s].
  void look(double now, bool wrong, double time);
  void forget() { *this = {}; }
  /// Whether the condition lasted that long at the last observation.
  bool lasts() const { return lasts_; }

 private:
  double since_ = std::numeric_limits<double>::quiet_NaN();
  bool lasts_ = false;
};

/// Distinguishes a fault from spikes, including a fault that flickers: time in which the condition
/// is right compensates for time in which it was wrong, at half the rate. A condition that is wrong
/// for less than a third of the time therefore counts as spikes. The time between two observations
/// that disagree hardly counts.
class SpikeFilter {
 public:
  /// @param time  accumulated time that counts as a fault [s].
  void look(double now, bool wrong, double time);
  void forget() { *this = {}; }
  /// Whether the condition was wrong at the last observation and had been for that long.
  bool lasts() const { return lasts_; }

 private:
  // Start of the wrong time, moved later by the compensation; time of the last observation.
  double since_ = 0, at_ = 0;
  bool wrong_ = false, lasts_ = false;
};

/// Monitors the readings of one channel of a regulator against its set point and its rules. All
/// times are on one steady clock [s], all pressures are gauge [Pa]. Nothing allocates or throws.
class ChannelWatch {
 public:
  /// Begins to monitor a vented channel that starts to regulate.
  void begin(double now);
  /// Sets the set point from now on.
  void follow(double now, double set_point, const SafetyRules& rules);
  /// Adds a finite reading. `asked` is the time when it was requested, not after `now`.
  void measured(double now, double asked, double reading, const ChannelRules& channel,
                const SafetyRules& rules);

  double reading() const { return reading_; }                  ///< the newest; NaN if none
  double silence(double now) const { return now - read_at_; }  ///< age of the newest reading [s]
  /// Absolute difference of the newest reading from a first-order lag of the set point.
  double deviation() const;
  /// Difference by which the newest reading is nearer to the atmosphere than the set point.
  double drop() const;
  /// Whether the newest readings show no pressure (spikes ignored) and are no older than allowed.
  bool empty(double now, const SafetyRules& rules) const;

  /// Conditions that lasted, as of the newest reading.
  bool overLimit() const { return over_limit_.lasts(); }
  bool notFollowing() const { return not_following_.lasts(); }
  bool leaks() const { return leak_.lasts(); }
  bool standing() const { return standing_.lasts(); }  ///< pressure is present
  /// Whether all readings of a time as long as a spike's have shown no pressure, since
  /// waitForEmpty() or just before it. Noise alone may show a channel empty() whose last pressure
  /// is leaving.
  bool wasEmpty() const { return was_empty_; }
  void waitForEmpty();

 private:
  void pass(double now, const SafetyRules& rules);

  double reading_ = std::numeric_limits<double>::quiet_NaN();
  double read_at_ = -std::numeric_limits<double>::infinity();
  double empty_at_ = -std::numeric_limits<double>::infinity();  // the newest that shows no pressure
  double set_point_ = 0;
  double stands_at_ = 0;  // the set point without its small fluctuations
  double reference_ = 0;  // reading expected of a healthy channel
  double reference_at_ = -std::numeric_limits<double>::infinity();  // time of reference_
  bool arrived_ = false;  // has stayed at the set point since it last changed
  SpikeFilter over_limit_, arrival_, leak_;
  Persistence not_following_, standing_, gone_;
  bool was_empty_ = false;
};

/// The limits, extended to the atmosphere: the range of set points at these limits or on the way to
/// them from the atmosphere.
model::Range onTheWay(const model::Range& limits);

/// Bounds beyond which a reading counts as over the limits: the channel's range including the
/// atmosphere, widened by the margin. There is no lower bound for a channel that is never
/// evacuated.
double highestReading(const ChannelRules& channel, const SafetyRules& rules);
double lowestReading(const ChannelRules& channel, const SafetyRules& rules);

/// The first rule of `next` that is looser than the current one, that is, that would permit more
/// pressure, or pressure for longer. The text contains both values; it is empty if no rule is
/// looser. Both lists have the same channels.
std::string loosened(const std::vector<ChannelRules>& channels, const SafetyRules& rules,
                     const std::vector<ChannelRules>& next_channels, const SafetyRules& next);

/// State of the pressure path and its history.
struct SafetyReport {
  SafetyState state = SafetyState::kDisabled;
  /// Cause of the newest fault; if several came together, of the first one.
  SafetyCause cause = SafetyCause::kNone;
  int channel = -1;      ///< channel that caused it; -1 if it was not a single channel
  double value = 0;      ///< observed value of the cause [Pa] or [s]
  double limit = 0;      ///< limit of the rule for that value
  double since = 0;      ///< time when this state began [s]
  bool stopped = false;  ///< whether the emergency stop is engaged
  /// Whether all events since it was enabled end by themselves: silence of the commander or of the
  /// regulator, or a lost link. False after a stop or a requested vent.
  bool passing = true;
  bool vent_overdue = false;  ///< pressure remains after vent_time
  bool resting = false;       ///< in kEnabled: ramps down to rest
  /// Number of changes of the link and of the fields above except `value`.
  std::uint64_t changes = 0;
};

/// A state in words; clauses are empty where there is nothing to say.
struct SafetyText {
  std::string problem;  ///< what is wrong, with value and rule, or what the arm does
  std::string action;   ///< what the channels do about it
  std::string remedy;   ///< what to do next
  /// "<state>: <problem>: <action>; <remedy>".
  std::string line(SafetyState state) const;
};

/// Safety layer between commanders and the regulator. It decides in every turn what each channel
/// does.
///
/// A regulating channel always has a set point within its limits, or on the way to them from the
/// atmosphere, that moves no faster than its slew rate. After a fault every channel vents:
/// immediately or, if its action is hold or close, after hold_time. The emergency stop, a requested
/// vent, and conditions that are themselves dangerous (over limit, leak, not venting) vent every
/// channel immediately.
///
/// A commander that is done calls rest(): all set points ramp down to the atmosphere at their slew
/// rates, and the arm then vents in kDisabled, without a fault. On the ramp all rules apply except
/// that on the silence of the commander.
///
/// All times are on one steady clock [s] and must not decrease; an earlier time counts as the last
/// one. Nothing after the constructor allocates, locks or throws, except text(), reason(),
/// refusal(), enable() and adopt().
class SafetyCore {
 public:
  /// The initial state is kDisabled: all channels vent.
  /// @throws std::invalid_argument naming the channel or rule that breaks the contract.
  SafetyCore(std::vector<ChannelRules> channels, const SafetyRules& rules);

  /// Why it cannot be enabled now; empty if it can. It can be enabled from kDisabled and kVented.
  /// The emergency stop must be released, the guard (if needed) must answer, fresh readings must
  /// show no pressure, the regulator must answer, and the supply must suffice.
  std::string refusal(double now) const;
  /// Enables the arm, with set points that move from the atmosphere to the nearest limits, or
  /// returns the reason for refusal. The target watchdog starts with the first target.
  /// @return as refusal().
  std::string enable(double now);
  /// Whether a target alone may enable the arm, if the user permits that at all: before it was
  /// enabled for the first time, and after events that end by themselves (SafetyReport::passing).
  bool mayEnableItself() const;
  /// Ramps all channels down to the atmosphere and ends in kDisabled, with cause kNone, once fresh
  /// readings show no pressure. Pressure that remains vent_time after the ramp is kNotVenting. A
  /// target during the ramp cancels it. Again during the ramp, it changes nothing. Returns false,
  /// without effect, unless enabled.
  bool rest(double now);
  /// Vents all channels; ends in kVented. While disabled or vented, it only makes mayEnableItself()
  /// false.
  void vent(double now);
  /// Engaged: vents all channels, latched. Released: nothing moves, but the arm can be enabled
  /// again.
  void emergencyStop(double now, bool engaged);

  /// Sets the target pressures: (channels) gauge [Pa]. Values are clamped to the limits; an entry
  /// that is not finite leaves its channel unchanged, or, where the target cancels a rest, at the
  /// limit nearest to the atmosphere. Returns false, without effect, unless enabled.
  bool target(double now, const Eigen::Ref<const Eigen::VectorXd>& pressure);
  /// Adds the regulator's readings: (channels) gauge [Pa], where an entry that is not finite is no
  /// reading; and the supply pressure, NaN if it is not measured.
  /// @param age  time since the reading was requested, >= 0 [s]; it counts towards the permitted
  ///     silence.
  void measured(double now, const Eigen::Ref<const Eigen::VectorXd>& pressure,
                double supply = std::numeric_limits<double>::quiet_NaN(), double age = 0);
  /// Sets whether the regulator's link is up; initially it counts as up.
  void linked(double now, bool up);
  bool linked() const { return link_up_; }
  /// Sets the state of the guard, initially kNotNeeded. If a guard is needed, the arm can be
  /// enabled only while it answers, and vents all channels when it no longer does.
  void guarded(double now, Guard guard);

  /// Advances the time to `now` and returns the orders until the next turn.
  const ValveOrders& advance(double now);

  /// Replaces the rules of the same channels; state, orders and timers continue.
  /// @throws std::invalid_argument as the constructor, and if the channels differ or a channel
  ///     regulates at, or on the way to, a pressure that its new limits do not permit. The old
  ///     rules are then kept.
  void adopt(std::vector<ChannelRules> channels, const SafetyRules& rules);

  const ValveOrders& orders() const { return orders_; }  ///< of the last turn
  const SafetyReport& report() const { return report_; }
  SafetyState state() const { return report_.state; }
  /// (channels) target of each set point [Pa].
  const Eigen::VectorXd& goal() const { return goal_; }
  /// Newest finite readings (channels), NaN before the first [Pa].
  const Eigen::VectorXd& reading() const { return reading_; }
  const std::vector<ChannelRules>& channels() const { return channels_; }
  const SafetyRules& rules() const { return rules_; }
  SafetyText text() const;
  /// One line: the state, its cause with value and rule, and the remedy.
  std::string reason() const { return text().line(report_.state); }

 private:
  int count() const { return static_cast<int>(channels_.size()); }
  bool isVented() const;  // in kDisabled or kVented
  void pass(double now);
  double startOf(int i) const;
  void setState(SafetyState state, SafetyCause cause, int channel, double value, double limit);
  void raise(SafetyCause cause, int channel, double value, double limit);
  void release(int channel);
  void cancelRest();
  void endRest();
  void watchTimes();
  void watchReadings();
  void regulate(double dt);
  void endHold();
  void endFault();
  bool allVentAndEmpty() const;
  int overdueChannel() const;  // the first that still has pressure after vent_time; -1 if none
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
  double target_at_ = std::numeric_limits<double>::infinity();  // time of the last one since it was
                                                                // enabled or rested; infinite if
                                                                // none
  // End of the ramp down to rest, infinite before it [s]; whether kDisabled began with it.
  double down_at_ = std::numeric_limits<double>::infinity();
  bool rested_ = false;
  double now_ = 0;
  double turn_at_ = 0;
  bool started_ = false;
  bool link_up_ = true;
  Guard guard_ = Guard::kNotNeeded;
};

}  // namespace helix_arm::control
