#pragma once

#include <limits>

#include "helix_arm/model/contraction.hpp"

namespace helix_arm::control {

struct ChannelRules;
struct SafetyRules;

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
  bool arrived_ = false;  // has reached the set point since it last changed
  SpikeFilter over_limit_, leak_;
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

}  // namespace helix_arm::control
