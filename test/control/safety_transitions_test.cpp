#include "support/safety_bench.hpp"

namespace helix_arm::control {
namespace {

using test::Bench;
using test::kTurn;
using State = SafetyState;
using Cause = SafetyCause;

constexpr double kNone = std::numeric_limits<double>::quiet_NaN();
constexpr double kLong = 30;          // [s], longer than any rule's time
constexpr double kSpike = 8 * kTurn;  // the bench's spike time
constexpr double kTooHigh = 4.5e5;    // over limit and margin [Pa]

// How the bench gets into each state.

void disabled(Bench& b) { b.turn(); }
void enabled(Bench& b) { b.start().run(5); }  // all stand at their goal
void enabledUntouched(Bench& b) { b.silent().start().turn(); }
// Has just begun to ramp down to rest.
void resting(Bench& b) {
  enabled(b);
  ASSERT_TRUE(b.silent().core.rest(b.now));
}
void rested(Bench& b) {
  resting(b);
  ASSERT_TRUE(b.reach(State::kDisabled));
  b.run(2);
}
// In a fault that each channel meets with its own action.
void holding(Bench& b) {
  enabled(b);
  ASSERT_TRUE(b.silent().reach(State::kFault));
}
void holdingEmpty(Bench& b) {
  b.goal.setZero();
  holding(b);
}
// Has just begun to vent all.
void venting(Bench& b) {
  enabled(b);
  b.core.vent(b.now);
}
void vented(Bench& b) {
  venting(b);
  ASSERT_TRUE(b.reach(State::kVented));
  b.run(2);
}
void ventedAndStopped(Bench& b) {
  enabled(b);
  b.core.emergencyStop(b.now, true);
  ASSERT_TRUE(b.reach(State::kVented));
}

// What can happen.

void enable(Bench& b) { b.core.enable(b.now); }
void vent(Bench& b) { b.core.vent(b.now); }
void rest(Bench& b) { EXPECT_TRUE(b.core.rest(b.now)); }
void restInVain(Bench& b) { EXPECT_FALSE(b.core.rest(b.now)); }
void stop(Bench& b) { b.core.emergencyStop(b.now, true); }
void release(Bench& b) { b.core.emergencyStop(b.now, false); }
void linkLost(Bench& b) { b.core.linked(b.now, false); }
void linkUp(Bench& b) { b.core.linked(b.now, true); }
void nothing(Bench& b) { b.turn(); }
void target(Bench& b) {
  b.core.target(b.now, b.goal);
  b.turn();
}
void noTarget(Bench& b) { b.silent().run(kLong); }
void noReading(Bench& b) { b.unread().run(kLong); }
void noReadingForAWhile(Bench& b) { b.unread().run(0.5); }
// Only until the fault is there: what it does with each channel is to be seen.
void noReadingOfOne(Bench& b) { b.readsAs(1, kNone).run(0.5 + kTurn); }
void noSupplyReading(Bench& b) { b.supplied(kNone).run(0.5 + kTurn); }
void lowSupply(Bench& b) { b.supplied(3e5).run(kSpike + kTurn); }
void dipOfSupply(Bench& b) { b.supplied(3e5).run(kSpike).supplied(5e5).run(1); }
void overLimit(Bench& b) { b.readsAs(1, kTooHigh).run(kSpike + kTurn); }
void spike(Bench& b) { b.readsAs(1, kTooHigh).run(kSpike).readsTrue().run(1); }
template <int channel>
void stuckHigh(Bench& b) {
  b.readsOff(channel, 5e4).run(1 + kTurn);
}
void stuckHighForAWhile(Bench& b) { b.readsOff(1, 5e4).run(1).readsTrue().run(1); }
template <int channel>
void leak(Bench& b) {
  b.readsOff(channel, -3e4).run(kSpike + kTurn);
}
void dip(Bench& b) { b.readsOff(1, -3e4).run(kSpike).readsTrue().run(1); }
void standing(Bench& b) { b.readsAs(1, 2e4).run(kSpike + kTurn); }
void standingForAWhile(Bench& b) { b.readsAs(1, 2e4).run(kSpike).readsTrue().run(1); }
template <Guard guard>
void guarded(Bench& b) {
  b.core.guarded(b.now, guard);
}
void timePasses(Bench& b) { b.run(7.5); }
void holdTimePasses(Bench& b) { b.turn(8); }
void holdTimePassesUnread(Bench& b) { b.unread().run(10); }
void belowAtmosphere(Bench& b) { b.readsAs(1, -3e4).run(1); }
void emptied(Bench& b) { b.run(2); }
void halfASecond(Bench& b) { b.run(0.5); }
void timeout(Bench& b) { b.run(1 + kTurn); }
// For longer than the ramp and the bench's vent time.
void stayingFull(Bench& b) { b.readsAs(1, 2e4).run(3.5); }
void emptiedButForOne(Bench& b) { b.readsAs(1, 2e4).run(2); }
void emptiedButOneUnread(Bench& b) { b.readsAs(1, kNone).run(2); }
template <void (*first)(Bench&), void (*second)(Bench&)>
void both(Bench& b) {
  first(b);
  second(b);
}
// Enable, where something stands against it.
template <void (*what)(Bench&)>
void enableWith(Bench& b) {
  what(b);
  EXPECT_NE(b.core.enable(b.now), "");
}

struct Row {
  const char* what;
  State from;
  void (*prepare)(Bench&);
  void (*event)(Bench&);
  State to;
  Cause cause;
  const char* orders;  // of the channel that vents, that holds and that closes
};

const Row kTable[] = {
    // clang-format off
    {"enable", State::kDisabled, disabled, enable, State::kEnabled, Cause::kNone, "rrr"},
    {"enable, pressure stands", State::kDisabled, disabled, enableWith<standing>, State::kDisabled, Cause::kNone, "vvv"},
    {"enable, never read", State::kDisabled, [](Bench&) {}, enableWith<enable>, State::kDisabled, Cause::kNone, "vvv"},
    {"enable, reading stale", State::kDisabled, disabled, enableWith<noReading>, State::kDisabled, Cause::kNone, "vvv"},
    {"enable, link down", State::kDisabled, disabled, enableWith<linkLost>, State::kDisabled, Cause::kNone, "vvv"},
    {"enable, link up again", State::kDisabled, disabled, both<both<linkLost, linkUp>, enable>, State::kEnabled, Cause::kNone, "rrr"},
    {"enable, low supply", State::kDisabled, disabled, enableWith<lowSupply>, State::kDisabled, Cause::kNone, "vvv"},
    {"enable, supply unread", State::kDisabled, disabled, enableWith<noSupplyReading>, State::kDisabled, Cause::kNone, "vvv"},
    {"enable, guard starts", State::kDisabled, disabled, enableWith<guarded<Guard::kStarting>>, State::kDisabled, Cause::kNone, "vvv"},
    {"enable, guard does not respond", State::kDisabled, disabled, enableWith<guarded<Guard::kStandsStill>>, State::kDisabled, Cause::kNone, "vvv"},
    {"enable, guard gone", State::kDisabled, disabled, enableWith<guarded<Guard::kEnded>>, State::kDisabled, Cause::kNone, "vvv"},
    {"enable, guard stands", State::kDisabled, disabled, both<guarded<Guard::kStands>, enable>, State::kEnabled, Cause::kNone, "rrr"},
    {"guard lost", State::kDisabled, disabled, guarded<Guard::kEnded>, State::kDisabled, Cause::kNone, "vvv"},
    {"vent", State::kDisabled, disabled, vent, State::kDisabled, Cause::kNone, "vvv"},
    {"rest", State::kDisabled, disabled, restInVain, State::kDisabled, Cause::kNone, "vvv"},
    {"target", State::kDisabled, disabled, target, State::kDisabled, Cause::kNone, "vvv"},
    {"no target", State::kDisabled, disabled, noTarget, State::kDisabled, Cause::kNone, "vvv"},
    {"no reading", State::kDisabled, disabled, noReading, State::kDisabled, Cause::kNone, "vvv"},
    {"link lost", State::kDisabled, disabled, linkLost, State::kDisabled, Cause::kNone, "vvv"},
    {"low supply", State::kDisabled, disabled, lowSupply, State::kDisabled, Cause::kNone, "vvv"},
    {"pressure below the limit", State::kDisabled, disabled, standing, State::kDisabled, Cause::kNone, "vvv"},
    {"below the atmosphere", State::kDisabled, disabled, belowAtmosphere, State::kDisabled, Cause::kNone, "vvv"},
    {"release, not stopped", State::kDisabled, disabled, release, State::kDisabled, Cause::kNone, "vvv"},
    {"stop", State::kDisabled, disabled, stop, State::kFault, Cause::kEmergencyStop, "vvv"},
    {"over limit", State::kDisabled, disabled, overLimit, State::kFault, Cause::kOverLimit, "vvv"},
    {"spike", State::kDisabled, disabled, spike, State::kDisabled, Cause::kNone, "vvv"},
    {"at rest, enable", State::kDisabled, rested, enable, State::kEnabled, Cause::kNone, "rrr"},
    {"at rest, pressure stands", State::kDisabled, rested, standing, State::kFault, Cause::kNotVenting, "vvv"},
    {"at rest, pressure comes and goes", State::kDisabled, rested, standingForAWhile, State::kDisabled, Cause::kNone, "vvv"},

    {"enable", State::kEnabled, enabled, enableWith<nothing>, State::kEnabled, Cause::kNone, "rrr"},
    {"target", State::kEnabled, enabled, target, State::kEnabled, Cause::kNone, "rrr"},
    {"release, not stopped", State::kEnabled, enabled, release, State::kEnabled, Cause::kNone, "rrr"},
    {"link up", State::kEnabled, enabled, linkUp, State::kEnabled, Cause::kNone, "rrr"},
    {"time passes", State::kEnabled, enabled, timePasses, State::kEnabled, Cause::kNone, "rrr"},
    {"vent", State::kEnabled, enabled, vent, State::kFault, Cause::kVentRequested, "vvv"},
    {"guard lost", State::kEnabled, enabled, guarded<Guard::kEnded>, State::kFault, Cause::kGuardLost, "vvv"},
    {"guard does not respond", State::kEnabled, enabled, guarded<Guard::kStandsStill>, State::kFault, Cause::kGuardLost, "vvv"},
    {"another guard starts", State::kEnabled, enabled, guarded<Guard::kStarting>, State::kFault, Cause::kGuardLost, "vvv"},
    {"guard stands", State::kEnabled, enabled, guarded<Guard::kStands>, State::kEnabled, Cause::kNone, "rrr"},
    {"stop", State::kEnabled, enabled, stop, State::kFault, Cause::kEmergencyStop, "vvv"},
    {"no target any more", State::kEnabled, enabled, [](Bench& b) { b.silent().run(1.5); }, State::kFault, Cause::kStaleTarget, "vrc"},
    {"no target yet", State::kEnabled, enabledUntouched, noTarget, State::kEnabled, Cause::kNone, "rrr"},
    {"no reading of one", State::kEnabled, enabled, noReadingOfOne, State::kFault, Cause::kStaleReading, "vvc"},
    {"no reading for a while", State::kEnabled, enabled, noReadingForAWhile, State::kEnabled, Cause::kNone, "rrr"},
    {"supply unread", State::kEnabled, enabled, noSupplyReading, State::kFault, Cause::kStaleReading, "vrc"},
    {"link lost", State::kEnabled, enabled, linkLost, State::kFault, Cause::kRegulatorLost, "vvv"},
    {"over limit", State::kEnabled, enabled, overLimit, State::kFault, Cause::kOverLimit, "vvv"},
    {"spike", State::kEnabled, enabled, spike, State::kEnabled, Cause::kNone, "rrr"},
    {"low supply", State::kEnabled, enabled, lowSupply, State::kFault, Cause::kLowSupply, "vrc"},
    {"dip of supply", State::kEnabled, enabled, dipOfSupply, State::kEnabled, Cause::kNone, "rrr"},
    {"one does not follow", State::kEnabled, enabled, stuckHigh<0>, State::kFault, Cause::kNotFollowing, "vrc"},
    {"the held one does not follow", State::kEnabled, enabled, stuckHigh<1>, State::kFault, Cause::kNotFollowing, "vvc"},
    {"the closed one does not follow", State::kEnabled, enabled, stuckHigh<2>, State::kFault, Cause::kNotFollowing, "vrv"},
    {"one is late", State::kEnabled, enabled, stuckHighForAWhile, State::kEnabled, Cause::kNone, "rrr"},
    {"leak", State::kEnabled, enabled, leak<1>, State::kFault, Cause::kLeak, "vvv"},
    {"dip", State::kEnabled, enabled, dip, State::kEnabled, Cause::kNone, "rrr"},
    {"rest", State::kEnabled, enabled, rest, State::kEnabled, Cause::kNone, "rrr"},
    {"rest without a target", State::kEnabled, enabledUntouched, both<rest, emptied>, State::kDisabled, Cause::kNone, "vvv"},
    {"resting, empty", State::kEnabled, resting, emptied, State::kDisabled, Cause::kNone, "vvv"},
    {"resting, no target", State::kEnabled, resting, noTarget, State::kDisabled, Cause::kNone, "vvv"},
    {"resting, rest again", State::kEnabled, resting, both<rest, emptied>, State::kDisabled, Cause::kNone, "vvv"},
    {"resting, enable", State::kEnabled, resting, both<enableWith<nothing>, emptied>, State::kDisabled, Cause::kNone, "vvv"},
    {"resting, target", State::kEnabled, resting, both<target, halfASecond>, State::kEnabled, Cause::kNone, "rrr"},
    {"resting, target, then silence", State::kEnabled, resting, both<target, timeout>, State::kFault, Cause::kStaleTarget, "vrc"},
    {"resting, vent", State::kEnabled, resting, vent, State::kFault, Cause::kVentRequested, "vvv"},
    {"resting, stop", State::kEnabled, resting, stop, State::kFault, Cause::kEmergencyStop, "vvv"},
    {"resting, guard lost", State::kEnabled, resting, guarded<Guard::kEnded>, State::kFault, Cause::kGuardLost, "vvv"},
    {"resting, link lost", State::kEnabled, resting, linkLost, State::kFault, Cause::kRegulatorLost, "vvv"},
    {"resting, no reading of one", State::kEnabled, resting, noReadingOfOne, State::kFault, Cause::kStaleReading, "vvc"},
    {"resting, supply unread", State::kEnabled, resting, noSupplyReading, State::kFault, Cause::kStaleReading, "vrc"},
    {"resting, low supply", State::kEnabled, resting, lowSupply, State::kFault, Cause::kLowSupply, "vrc"},
    {"resting, over limit", State::kEnabled, resting, overLimit, State::kFault, Cause::kOverLimit, "vvv"},
    {"resting, one does not follow", State::kEnabled, resting, stuckHigh<1>, State::kFault, Cause::kNotFollowing, "vvc"},
    {"resting, one is late", State::kEnabled, resting, both<stuckHighForAWhile, nothing>, State::kDisabled, Cause::kNone, "vvv"},
    {"resting, empty but for one", State::kEnabled, resting, emptiedButForOne, State::kEnabled, Cause::kNone, "rrr"},
    {"resting, pressure stands", State::kEnabled, resting, stayingFull, State::kFault, Cause::kNotVenting, "vvv"},

    {"time passes", State::kFault, holding, timePasses, State::kFault, Cause::kStaleTarget, "vrc"},
    {"hold time passes", State::kFault, holding, holdTimePasses, State::kFault, Cause::kStaleTarget, "vvv"},
    {"vent", State::kFault, holding, vent, State::kFault, Cause::kStaleTarget, "vvv"},
    {"rest", State::kFault, holding, restInVain, State::kFault, Cause::kStaleTarget, "vrc"},
    {"stop", State::kFault, holding, stop, State::kFault, Cause::kStaleTarget, "vvv"},
    {"guard lost", State::kFault, holding, guarded<Guard::kEnded>, State::kFault, Cause::kStaleTarget, "vvv"},
    {"over limit", State::kFault, holding, overLimit, State::kFault, Cause::kStaleTarget, "vvv"},
    {"spike", State::kFault, holding, spike, State::kFault, Cause::kStaleTarget, "vrc"},
    {"leak of the held", State::kFault, holding, leak<1>, State::kFault, Cause::kStaleTarget, "vvv"},
    {"leak of the closed", State::kFault, holding, leak<2>, State::kFault, Cause::kStaleTarget, "vvv"},
    {"link lost", State::kFault, holding, linkLost, State::kFault, Cause::kStaleTarget, "vvv"},
    {"no reading of one", State::kFault, holding, noReadingOfOne, State::kFault, Cause::kStaleTarget, "vvc"},
    {"low supply", State::kFault, holding, lowSupply, State::kFault, Cause::kStaleTarget, "vrc"},
    {"one does not follow", State::kFault, holding, stuckHigh<1>, State::kFault, Cause::kStaleTarget, "vvc"},
    {"target", State::kFault, holding, target, State::kFault, Cause::kStaleTarget, "vrc"},
    {"enable", State::kFault, holding, enableWith<nothing>, State::kFault, Cause::kStaleTarget, "vrc"},
    {"empty, but holds", State::kFault, holdingEmpty, timePasses, State::kFault, Cause::kStaleTarget, "vrc"},
    {"empty, hold time passes", State::kFault, holdingEmpty, both<holdTimePasses, nothing>, State::kVented, Cause::kStaleTarget, "vvv"},
    {"was empty, unread since", State::kFault, holdingEmpty, holdTimePassesUnread, State::kFault, Cause::kStaleTarget, "vvv"},
    {"enable", State::kFault, venting, enableWith<nothing>, State::kFault, Cause::kVentRequested, "vvv"},
    {"rest", State::kFault, venting, restInVain, State::kFault, Cause::kVentRequested, "vvv"},
    {"pressure falls", State::kFault, venting, nothing, State::kFault, Cause::kVentRequested, "vvv"},
    {"empty", State::kFault, venting, emptied, State::kVented, Cause::kVentRequested, "vvv"},
    {"empty but for one", State::kFault, venting, emptiedButForOne, State::kFault, Cause::kVentRequested, "vvv"},
    {"one unread", State::kFault, venting, emptiedButOneUnread, State::kFault, Cause::kVentRequested, "vvv"},

    {"enable", State::kVented, vented, enable, State::kEnabled, Cause::kNone, "rrr"},
    {"enable, stopped", State::kVented, ventedAndStopped, enableWith<nothing>, State::kVented, Cause::kEmergencyStop, "vvv"},
    {"release", State::kVented, ventedAndStopped, release, State::kVented, Cause::kEmergencyStop, "vvv"},
    {"release and enable", State::kVented, ventedAndStopped, both<release, enable>, State::kEnabled, Cause::kNone, "rrr"},
    {"stop again, stopped", State::kVented, ventedAndStopped, stop, State::kVented, Cause::kEmergencyStop, "vvv"},
    {"enable, guard gone", State::kVented, vented, enableWith<guarded<Guard::kEnded>>, State::kVented, Cause::kVentRequested, "vvv"},
    {"guard lost", State::kVented, vented, guarded<Guard::kEnded>, State::kVented, Cause::kVentRequested, "vvv"},
    {"enable, link down", State::kVented, vented, enableWith<linkLost>, State::kVented, Cause::kVentRequested, "vvv"},
    {"enable, reading stale", State::kVented, vented, enableWith<noReading>, State::kVented, Cause::kVentRequested, "vvv"},
    {"enable, low supply", State::kVented, vented, enableWith<lowSupply>, State::kVented, Cause::kVentRequested, "vvv"},
    {"vent", State::kVented, vented, vent, State::kVented, Cause::kVentRequested, "vvv"},
    {"rest", State::kVented, vented, restInVain, State::kVented, Cause::kVentRequested, "vvv"},
    {"target", State::kVented, vented, target, State::kVented, Cause::kVentRequested, "vvv"},
    {"no target", State::kVented, vented, noTarget, State::kVented, Cause::kVentRequested, "vvv"},
    {"no reading", State::kVented, vented, noReading, State::kVented, Cause::kVentRequested, "vvv"},
    {"link lost", State::kVented, vented, linkLost, State::kVented, Cause::kVentRequested, "vvv"},
    {"low supply", State::kVented, vented, lowSupply, State::kVented, Cause::kVentRequested, "vvv"},
    {"stop", State::kVented, vented, stop, State::kFault, Cause::kEmergencyStop, "vvv"},
    {"over limit", State::kVented, vented, overLimit, State::kFault, Cause::kOverLimit, "vvv"},
    {"pressure stands", State::kVented, vented, standing, State::kFault, Cause::kNotVenting, "vvv"},
    {"pressure comes and goes", State::kVented, vented, standingForAWhile, State::kVented, Cause::kVentRequested, "vvv"},
    // clang-format on
};

TEST(SafetyTransitions, EveryEventLeadsWhereTheTableSays) {
  for (const Row& row : kTable) {
    SCOPED_TRACE(std::string(nameOf(row.from)) + ", " + row.what);
    Bench bench;
    row.prepare(bench);
    ASSERT_EQ(bench.state(), row.from);
    row.event(bench);
    EXPECT_STREQ(nameOf(bench.state()), nameOf(row.to)) << bench.core.reason();
    EXPECT_STREQ(nameOf(bench.cause()), nameOf(row.cause));
    EXPECT_EQ(bench.orders(), row.orders);
  }
}

// Whatever comes first: silence and a lost link pass by themselves, nothing else does.
TEST(SafetyTransitions, ATargetAloneEnablesOnlyAfterWhatPassesByItself) {
  using Event = void (*)(Bench&);
  const Event passing[] = {noTarget,       noReadingForAWhile,
                           noReadingOfOne, linkLost,
                           nothing,        [](Bench& b) { b.core.rest(b.now); }};
  const std::pair<Event, bool> lasting[] = {// and whether it is a fault of a vented arm, too
                                            {stop, true},          {vent, true},
                                            {overLimit, true},     {leak<1>, false},
                                            {stuckHigh<0>, false}, {guarded<Guard::kEnded>, false}};
  // Afterwards all is well again, and empty.
  const auto rests = [](Bench& bench) {
    release(bench);
    linkUp(bench);
    bench.core.guarded(bench.now, Guard::kNotNeeded);
    bench.reads = true;
    bench.silent().readsTrue().run(kLong);
    return bench.core.refusal(bench.now).empty();
  };
  for (const Event first : passing) {
    Bench passed;
    enabled(passed);
    EXPECT_FALSE(passed.core.mayEnableItself());
    first(passed);
    ASSERT_TRUE(rests(passed)) << passed.core.reason();
    EXPECT_TRUE(passed.core.mayEnableItself()) << passed.core.reason();
    for (const auto& [second, ever] : lasting) {
      for (const bool reversed : {true, false}) {
        if (!reversed && !ever) continue;
        Bench bench;
        enabled(bench);
        (reversed ? second : first)(bench);
        bench.reads = true;
        (reversed ? first : second)(bench);
        ASSERT_TRUE(rests(bench)) << bench.core.reason();
        EXPECT_FALSE(bench.core.mayEnableItself()) << bench.core.reason();
        EXPECT_EQ(bench.core.enable(bench.now), "");
        noTarget(bench);
        EXPECT_FALSE(bench.core.mayEnableItself()) << "it is enabled";
      }
    }
  }
}

TEST(SafetyTransitions, AStopOrAVentOfAVentedArmBarsItAsWell) {
  for (const auto event : {stop, vent}) {
    for (const auto prepare : {disabled, holdingEmpty}) {
      Bench bench;
      prepare(bench);
      bench.silent().run(kLong);
      ASSERT_TRUE(bench.core.mayEnableItself()) << bench.core.reason();
      event(bench);
      release(bench);
      bench.run(kLong);
      EXPECT_FALSE(bench.core.mayEnableItself()) << bench.core.reason();
    }
  }
}

TEST(SafetyTransitions, TheFirstCauseIsKeptAndNamesItsChannelAndValues) {
  Bench bench;
  enabled(bench);
  bench.readsAs(2, kTooHigh);
  ASSERT_TRUE(bench.reach(State::kFault));
  const SafetyReport first = bench.core.report();
  EXPECT_EQ(first.cause, Cause::kOverLimit);
  EXPECT_EQ(first.channel, 2);
  EXPECT_EQ(first.value, kTooHigh);
  EXPECT_EQ(first.limit, 4.3e5);  // 400 kPa and a margin of 30
  EXPECT_EQ(first.since, bench.now);
  bench.core.emergencyStop(bench.now, true);
  EXPECT_EQ(bench.cause(), Cause::kOverLimit);
  EXPECT_TRUE(bench.core.report().stopped);
  EXPECT_GT(bench.core.report().changes, first.changes);
}

TEST(SafetyTransitions, AFaultIsSeenForATurnHoweverSoonItEnds) {
  Bench bench;
  enabledUntouched(bench);
  vent(bench);
  EXPECT_EQ(bench.state(), State::kFault);
  bench.turn();
  EXPECT_EQ(bench.state(), State::kVented);
}

}  // namespace
}  // namespace helix_arm::control
