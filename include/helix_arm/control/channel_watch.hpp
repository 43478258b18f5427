#pragma once

#include <limits>

#include "helix_arm/model/contraction.hpp"

namespace helix_arm::control {

struct ChannelRules;
struct SafetyRules;

/// Tells what lasts from what ends by itself: it is wrong on every look for a while.
class Persistence {
 public:
  /// @param time  how long it may last [s].
  void look(double now, bool wrong, double time);
  void forget() { *this = {}; }
  /// Whether it had lasted that long at the last look.
  bool lasts() const { return lasts_; }

 private:
  double since_ = std::numeric_limits<double>::quiet_NaN();
  bool lasts_ = false;
};

/// Tells a fault from spikes, also one that flickers: what is right makes up, at half the pace, for
/// what was wrong. What is wrong in less than a third of the time is spikes; and time in which
/// nobody looked, between two looks that disagree, hardly counts.
class SpikeFilter {
 public:
  /// @param time  how long it may be wrong [s].
  void look(double now, bool wrong, double time);
  void forget() { *this = {}; }
  /// Whether it is wrong, and had been for that long, at the last look.
  bool lasts() const { return lasts_; }

 private:
  double since_ = 0, at_ = 0;  // wrong, less what was made up for; the last look
  bool wrong_ = false, lasts_ = false;
};

/// Watches what one channel of a regulator reads, against its set point and the rules that hold for
/// it. All times are of one steady clock [s], all pressures gauge [Pa]. Nothing allocates or
/// throws.
class ChannelWatch {
 public:
  /// A vented channel begins to regulate.
  void begin(double now);
  /// From now on its set point is this one.
  void follow(double now, double set_point, const SafetyRules& rules);
  /// A finite reading, and when it was asked, not after now.
  void measured(double now, double asked, double reading, const ChannelRules& channel,
                const SafetyRules& rules);

  double reading() const { return reading_; }                  ///< the newest; NaN: none
  double silence(double now) const { return now - read_at_; }  ///< since it [s]
  /// How far its newest reading is from a first-order lag of the set point.
  double deviation() const;
  /// How much nearer to the atmosphere than the set point it reads.
  double drop() const;
  /// Whether its newest readings show no pressure, noise left aside, and are no older than allowed.
  bool empty(double now, const SafetyRules& rules) const;

  /// What lasted, as its newest reading had it.
  bool overLimit() const { return over_limit_.lasts(); }
  bool notFollowing() const { return not_following_.lasts(); }
  bool leaks() const { return leak_.lasts(); }
  bool standing() const { return standing_.lasts(); }  ///< pressure

 private:
  void pass(double now, const SafetyRules& rules);

  double reading_ = std::numeric_limits<double>::quiet_NaN();
  double read_at_ = -std::numeric_limits<double>::infinity();
  double empty_at_ = -std::numeric_limits<double>::infinity();  // the newest that shows no pressure
  double set_point_ = 0;
  double stands_at_ = 0;  // the set point, but for its trembling
  double reference_ = 0;  // what a healthy channel would read
  double reference_at_ = -std::numeric_limits<double>::infinity();  // then
  bool arrived_ = false;  // at the set point, since it stands
  SpikeFilter over_limit_, leak_;
  Persistence not_following_, standing_;
};

/// What is commanded of a channel with these limits, or on its way to them from the atmosphere.
model::Range onTheWay(const model::Range& limits);

/// Pressures beyond which a reading is over the limits: the range of a channel and the atmosphere,
/// widened by the margin. Nothing lies below a channel that is never evacuated.
double highestReading(const ChannelRules& channel, const SafetyRules& rules);
double lowestReading(const ChannelRules& channel, const SafetyRules& rules);

}  // namespace helix_arm::control
