#pragma once

#include <limits>

#include <gtest/gtest.h>

#include "support/safety_bench.hpp"

/// States of the bench, and what can happen to it: rows of the table of transitions.
namespace helix_arm::test::safety_events {

using control::Guard;
using State = control::SafetyState;

inline constexpr double kNone = std::numeric_limits<double>::quiet_NaN();
inline constexpr double kLong = 30;          // [s], longer than any rule's time
inline constexpr double kSpike = 8 * kTurn;  // the bench's spike time
inline constexpr double kTooHigh = 4.5e5;    // over limit and margin [Pa]

// How the bench gets into each state.

inline void disabled(Bench& bench) { bench.turn(); }

inline void enabled(Bench& bench) {
  bench.turn();
  ASSERT_EQ(bench.core.enable(bench.now), "");
  bench.run(5);  // all stand at their goal
}

inline void enabledUntouched(Bench& bench) {
  bench.commands = false;
  bench.turn();
  ASSERT_EQ(bench.core.enable(bench.now), "");
  bench.turn();
}

// Has just begun to ramp down to rest.
inline void resting(Bench& bench) {
  enabled(bench);
  bench.commands = false;
  ASSERT_TRUE(bench.core.rest(bench.now));
}

inline void rested(Bench& bench) {
  resting(bench);
  ASSERT_TRUE(bench.reach(State::kDisabled));
  bench.run(2);
}

// In a fault that each channel meets with its own action.
inline void holding(Bench& bench) {
  enabled(bench);
  bench.commands = false;
  ASSERT_TRUE(bench.reach(State::kFault));
}

// The same with nothing in the channels.
inline void holdingEmpty(Bench& bench) {
  bench.goal.setZero();
  holding(bench);
}

// Has just begun to vent all.
inline void venting(Bench& bench) {
  enabled(bench);
  bench.core.vent(bench.now);
}

inline void vented(Bench& bench) {
  venting(bench);
  ASSERT_TRUE(bench.reach(State::kVented));
  bench.run(2);
}

inline void ventedAndStopped(Bench& bench) {
  enabled(bench);
  bench.core.emergencyStop(bench.now, true);
  ASSERT_TRUE(bench.reach(State::kVented));
}

// What can happen.

inline void enable(Bench& bench) { bench.core.enable(bench.now); }
inline void vent(Bench& bench) { bench.core.vent(bench.now); }
inline void rest(Bench& bench) { EXPECT_TRUE(bench.core.rest(bench.now)); }
inline void restInVain(Bench& bench) { EXPECT_FALSE(bench.core.rest(bench.now)); }
inline void stop(Bench& bench) { bench.core.emergencyStop(bench.now, true); }
inline void release(Bench& bench) { bench.core.emergencyStop(bench.now, false); }
inline void linkLost(Bench& bench) { bench.core.linked(bench.now, false); }
inline void linkUp(Bench& bench) { bench.core.linked(bench.now, true); }
inline void nothing(Bench& bench) { bench.turn(); }
inline void target(Bench& bench) {
  bench.core.target(bench.now, bench.goal);
  bench.turn();
}
inline void noTarget(Bench& bench) {
  bench.commands = false;
  bench.run(kLong);
}
inline void noReading(Bench& bench) {
  bench.reads = false;
  bench.run(kLong);
}
inline void noReadingForAWhile(Bench& bench) {
  bench.reads = false;
  bench.run(0.5);
}
// Only until the fault is there: what it does with each channel is to be seen.
inline void noReadingOfOne(Bench& bench) {
  bench.readsAs(1, kNone);
  bench.run(0.5 + kTurn);
}
inline void noSupplyReading(Bench& bench) {
  bench.supply = kNone;
  bench.run(0.5 + kTurn);
}
inline void lowSupply(Bench& bench) {
  bench.supply = 3e5;
  bench.run(kSpike + kTurn);
}
inline void dipOfSupply(Bench& bench) {
  bench.supply = 3e5;
  bench.run(kSpike);
  bench.supply = 5e5;
  bench.run(1);
}
inline void overLimit(Bench& bench) {
  bench.readsAs(1, kTooHigh);
  bench.run(kSpike + kTurn);
}
inline void spike(Bench& bench) {
  bench.readsAs(1, kTooHigh);
  bench.run(kSpike);
  bench.spoil = nullptr;
  bench.run(1);
}
template <int channel>
void stuckHigh(Bench& bench) {
  bench.readsOff(channel, 5e4);
  bench.run(1 + kTurn);
}
inline void stuckHighForAWhile(Bench& bench) {
  bench.readsOff(1, 5e4);
  bench.run(1);
  bench.spoil = nullptr;
  bench.run(1);
}
template <int channel>
void leak(Bench& bench) {
  bench.readsOff(channel, -3e4);
  bench.run(kSpike + kTurn);
}
inline void dip(Bench& bench) {
  bench.readsOff(1, -3e4);
  bench.run(kSpike);
  bench.spoil = nullptr;
  bench.run(1);
}
inline void standing(Bench& bench) {
  bench.readsAs(1, 2e4);
  bench.run(kSpike + kTurn);
}
inline void standingForAWhile(Bench& bench) {
  bench.readsAs(1, 2e4);
  bench.run(kSpike);
  bench.spoil = nullptr;
  bench.run(1);
}
template <Guard guard>
void guarded(Bench& bench) {
  bench.core.guarded(bench.now, guard);
}
inline void timePasses(Bench& bench) { bench.run(7.5); }
inline void holdTimePasses(Bench& bench) { bench.turn(8); }
inline void holdTimePassesUnread(Bench& bench) {
  bench.reads = false;
  bench.run(10);
}
inline void belowAtmosphere(Bench& bench) {
  bench.readsAs(1, -3e4);
  bench.run(1);
}
inline void emptied(Bench& bench) { bench.run(2); }
inline void halfASecond(Bench& bench) { bench.run(0.5); }
inline void timeout(Bench& bench) { bench.run(1 + kTurn); }
// For longer than the ramp and the bench's vent time.
inline void stayingFull(Bench& bench) {
  bench.readsAs(1, 2e4);
  bench.run(3.5);
}
inline void emptiedButForOne(Bench& bench) {
  bench.readsAs(1, 2e4);
  bench.run(2);
}
inline void emptiedButOneUnread(Bench& bench) {
  bench.readsAs(1, kNone);
  bench.run(2);
}
template <void (*first)(Bench&), void (*second)(Bench&)>
void both(Bench& bench) {
  first(bench);
  second(bench);
}
// Enable, where something stands against it.
template <void (*what)(Bench&)>
void enableWith(Bench& bench) {
  what(bench);
  EXPECT_NE(bench.core.enable(bench.now), "");
}

}  // namespace helix_arm::test::safety_events
