#include <algorithm>
#include <cmath>

#include "helix_arm/control/safety.hpp"

namespace helix_arm::control {
namespace {

constexpr double kMends = 0.5;  // rate at which a correct reading undoes the time of a wrong one
// As fractions of the permitted time: the most that one interval between disagreeing readings
// counts, and the most that is remembered once the reading is right again.
constexpr double kBetween = 0.25, kRemembered = 2;
constexpr double kTremble = 0.2;  // of leak_drop: a set point that moves less counts as constant
// Time constants for which a reading has to stay within half of leak_drop to have arrived: more
// than one takes that falls through this band to an older set point leak_drop or more below (ln
// 3; 1.34 if the set point trembles). A device that is later than this may still look like a leak.
constexpr double kArrival = 1.5;

}  // namespace

void Persistence::look(double now, bool wrong, double time) {
  if (!wrong) {
    forget();
    return;
  }
  if (std::isnan(since_)) since_ = now;
  lasts_ = now - since_ >= time;
}

void SpikeFilter::look(double now, bool wrong, double time) {
  const double passed = wrong == wrong_ ? now - at_ : std::min(now - at_, kBetween * time);
  if (!wrong_) {
    const double counts = std::min(at_ - since_, kRemembered * time);
    since_ = now - std::max(counts - kMends * passed, 0.0);
  } else if (!wrong) {
    since_ = now - (at_ - since_ + passed);
  }
  at_ = now;
  wrong_ = wrong;
  lasts_ = wrong && now - since_ >= time;
}

model::Range onTheWay(const model::Range& limits) {
  return {std::min(limits.lower, 0.0), std::max(limits.upper, 0.0)};
}

double highestReading(const ChannelRules& channel, const SafetyRules& rules) {
  return onTheWay(channel.limits).upper + rules.trip_margin;
}

double lowestReading(const ChannelRules& channel, const SafetyRules& rules) {
  return channel.limits.lower < 0 ? channel.limits.lower - rules.trip_margin
                                  : -std::numeric_limits<double>::infinity();
}

void ChannelWatch::begin(double now) {
  set_point_ = stands_at_ = 0;
  reference_ = 0;
  reference_at_ = now;
  arrival_.forget();
  arrived_ = false;
  not_following_.forget();
  leak_.forget();
}

void ChannelWatch::pass(double now, const SafetyRules& rules) {
  const double time_constant =
      set_point_ < reference_ ? rules.fallTimeConstant() : rules.time_constant;
  const double covered = -std::expm1((reference_at_ - now) / time_constant);
  reference_ += covered * (set_point_ - reference_);
  reference_at_ = now;
}

void ChannelWatch::follow(double now, double set_point, const SafetyRules& rules) {
  pass(now, rules);
  // A commander whose targets jitter must not hide a leak.
  if (std::abs(set_point - stands_at_) > kTremble * rules.leak_drop) {
    stands_at_ = set_point;
    arrived_ = false;
    arrival_.forget();
    leak_.forget();
  }
  set_point_ = set_point;
}

double ChannelWatch::deviation() const { return std::abs(reading_ - reference_); }

double ChannelWatch::drop() const {
  return set_point_ >= 0 ? set_point_ - reading_ : reading_ - set_point_;
}

void ChannelWatch::measured(double now, double asked, double reading, const ChannelRules& channel,
                            const SafetyRules& rules) {
  pass(now, rules);
  reading_ = reading;
  read_at_ = asked;
  const bool has_pressure = std::abs(reading) > rules.vented_below;
  if (!has_pressure) empty_at_ = asked;
  arrival_.look(now, std::abs(reading - set_point_) <= rules.leak_drop / 2,
                kArrival * std::max(rules.time_constant, rules.fallTimeConstant()));
  arrived_ = arrived_ || arrival_.lasts();
  standing_.look(now, has_pressure, rules.spike_time);
  gone_.look(now, !has_pressure, rules.spike_time);
  was_empty_ = was_empty_ || gone_.lasts();
  over_limit_.look(
      now, reading > highestReading(channel, rules) || reading < lowestReading(channel, rules),
      rules.spike_time);
  not_following_.look(now, deviation() > rules.follow_tolerance, rules.follow_time);
  leak_.look(now, arrived_ && drop() > rules.leak_drop, rules.spike_time);
}

void ChannelWatch::waitForEmpty() { was_empty_ = gone_.lasts(); }

bool ChannelWatch::empty(double now, const SafetyRules& rules) const {
  return silence(now) <= rules.reading_timeout && !standing() &&
         (read_at_ == empty_at_ || read_at_ - empty_at_ < rules.spike_time);
}

}  // namespace helix_arm::control
