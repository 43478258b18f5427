#include <limits>
#include <set>
#include <utility>

#include <gtest/gtest.h>

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

// ---- How the bench gets into each state
// --------------------------------------------------------------

void disabled(Bench& bench) { bench.turn(); }

void enabled(Bench& bench) {
  bench.turn();
  ASSERT_EQ(bench.core.enable(bench.now), "");
  bench.run(5);  // all stand at their goal
}

void enabledUntouched(Bench& bench) {
  bench.commands = false;
  bench.turn();
  ASSERT_EQ(bench.core.enable(bench.now), "");
  bench.turn();
}

// In a fault that each channel meets with its own action.
void holding(Bench& bench) {
  enabled(bench);
  bench.commands = false;
  ASSERT_TRUE(bench.reach(State::kFault));
}

// The same with nothing in the channels.
void holdingEmpty(Bench& bench) {
  bench.goal.setZero();
  holding(bench);
}

// Has just begun to vent all.
void venting(Bench& bench) {
  enabled(bench);
  bench.core.vent(bench.now);
}

void vented(Bench& bench) {
  venting(bench);
  ASSERT_TRUE(bench.reach(State::kVented));
  bench.run(2);
}

void ventedAndStopped(Bench& bench) {
  enabled(bench);
  bench.core.emergencyStop(bench.now, true);
  ASSERT_TRUE(bench.reach(State::kVented));
}

// ---- What can happen
// ---------------------------------------------------------------------------------

void enable(Bench& bench) { bench.core.enable(bench.now); }
void vent(Bench& bench) { bench.core.vent(bench.now); }
void stop(Bench& bench) { bench.core.emergencyStop(bench.now, true); }
void release(Bench& bench) { bench.core.emergencyStop(bench.now, false); }
void linkLost(Bench& bench) { bench.core.linked(bench.now, false); }
void linkUp(Bench& bench) { bench.core.linked(bench.now, true); }
void nothing(Bench& bench) { bench.turn(); }
void target(Bench& bench) {
  bench.core.target(bench.now, bench.goal);
  bench.turn();
}
void noTarget(Bench& bench) {
  bench.commands = false;
  bench.run(kLong);
}
void noReading(Bench& bench) {
  bench.reads = false;
  bench.run(kLong);
}
void noReadingForAWhile(Bench& bench) {
  bench.reads = false;
  bench.run(0.5);
}
// Only until the fault is there: what it does with each channel is to be seen.
void noReadingOfOne(Bench& bench) {
  bench.readsAs(1, kNone);
  bench.run(0.5 + kTurn);
}
void noSupplyReading(Bench& bench) {
  bench.supply = kNone;
  bench.run(0.5 + kTurn);
}
void lowSupply(Bench& bench) {
  bench.supply = 3e5;
  bench.run(kSpike + kTurn);
}
void dipOfSupply(Bench& bench) {
  bench.supply = 3e5;
  bench.run(kSpike);
  bench.supply = 5e5;
  bench.run(1);
}
void overLimit(Bench& bench) {
  bench.readsAs(1, kTooHigh);
  bench.run(kSpike + kTurn);
}
void spike(Bench& bench) {
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
void stuckHighForAWhile(Bench& bench) {
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
void dip(Bench& bench) {
  bench.readsOff(1, -3e4);
  bench.run(kSpike);
  bench.spoil = nullptr;
  bench.run(1);
}
void standing(Bench& bench) {
  bench.readsAs(1, 2e4);
  bench.run(kSpike + kTurn);
}
void standingForAWhile(Bench& bench) {
  bench.readsAs(1, 2e4);
  bench.run(kSpike);
  bench.spoil = nullptr;
  bench.run(1);
}
template <Guard guard>
void guarded(Bench& bench) {
  bench.core.guarded(bench.now, guard);
}
void timePasses(Bench& bench) { bench.run(7.5); }
void holdTimePasses(Bench& bench) { bench.turn(8); }
void holdTimePassesUnread(Bench& bench) {
  bench.reads = false;
  bench.run(10);
}
void belowAtmosphere(Bench& bench) {
  bench.readsAs(1, -3e4);
  bench.run(1);
}
void emptied(Bench& bench) { bench.run(2); }
void emptiedButForOne(Bench& bench) {
  bench.readsAs(1, 2e4);
  bench.run(2);
}
void emptiedButOneUnread(Bench& bench) {
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
    {"enable, guard stands still", State::kDisabled, disabled, enableWith<guarded<Guard::kStandsStill>>, State::kDisabled, Cause::kNone, "vvv"},
    {"enable, guard gone", State::kDisabled, disabled, enableWith<guarded<Guard::kEnded>>, State::kDisabled, Cause::kNone, "vvv"},
    {"enable, guard stands", State::kDisabled, disabled, both<guarded<Guard::kStands>, enable>, State::kEnabled, Cause::kNone, "rrr"},
    {"guard lost", State::kDisabled, disabled, guarded<Guard::kEnded>, State::kDisabled, Cause::kNone, "vvv"},
    {"vent", State::kDisabled, disabled, vent, State::kDisabled, Cause::kNone, "vvv"},
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

    {"enable", State::kEnabled, enabled, enableWith<nothing>, State::kEnabled, Cause::kNone, "rrr"},
    {"target", State::kEnabled, enabled, target, State::kEnabled, Cause::kNone, "rrr"},
    {"release, not stopped", State::kEnabled, enabled, release, State::kEnabled, Cause::kNone, "rrr"},
    {"link up", State::kEnabled, enabled, linkUp, State::kEnabled, Cause::kNone, "rrr"},
    {"time passes", State::kEnabled, enabled, timePasses, State::kEnabled, Cause::kNone, "rrr"},
    {"vent", State::kEnabled, enabled, vent, State::kFault, Cause::kVentRequested, "vvv"},
    {"guard lost", State::kEnabled, enabled, guarded<Guard::kEnded>, State::kFault, Cause::kGuardLost, "vvv"},
    {"guard stands still", State::kEnabled, enabled, guarded<Guard::kStandsStill>, State::kFault, Cause::kGuardLost, "vvv"},
    {"another guard starts", State::kEnabled, enabled, guarded<Guard::kStarting>, State::kFault, Cause::kGuardLost, "vvv"},
    {"guard stands", State::kEnabled, enabled, guarded<Guard::kStands>, State::kEnabled, Cause::kNone, "rrr"},
    {"stop", State::kEnabled, enabled, stop, State::kFault, Cause::kEmergencyStop, "vvv"},
    {"no target any more", State::kEnabled, enabled, [](Bench& b) { b.commands = false; b.run(1.5); }, State::kFault, Cause::kStaleTarget, "vrc"},
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

    {"time passes", State::kFault, holding, timePasses, State::kFault, Cause::kStaleTarget, "vrc"},
    {"hold time passes", State::kFault, holding, holdTimePasses, State::kFault, Cause::kStaleTarget, "vvv"},
    {"vent", State::kFault, holding, vent, State::kFault, Cause::kStaleTarget, "vvv"},
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

TEST(SafetyTransitions, TheTableNamesEveryEdgeAndEveryCauseAndNoOther) {
  std::set<std::pair<State, State>> edges;
  std::set<Cause> causes;
  for (const Row& row : kTable) {
    if (row.from != row.to) edges.emplace(row.from, row.to);
    if (row.to == State::kFault && row.from != State::kFault) causes.insert(row.cause);
  }
  const std::set<std::pair<State, State>> documented = {
      {State::kDisabled, State::kEnabled}, {State::kDisabled, State::kFault},
      {State::kEnabled, State::kFault},    {State::kFault, State::kVented},
      {State::kVented, State::kEnabled},   {State::kVented, State::kFault}};
  EXPECT_EQ(edges, documented);
  EXPECT_EQ(causes.size(), kSafetyCauseCount - 1u);  // all but none
}

// Whatever comes first: silence and a lost link pass by themselves, nothing else does.
TEST(SafetyTransitions, ATargetAloneEnablesOnlyAfterWhatPassesByItself) {
  using Event = void (*)(Bench&);
  const Event passing[] = {noTarget, noReadingForAWhile, noReadingOfOne, linkLost, nothing};
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
    bench.spoil = nullptr;
    bench.commands = false;
    bench.run(kLong);
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
        bench.commands = false;
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
      bench.commands = false;
      bench.run(kLong);
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

TEST(SafetyTransitions, ChangesCountsWhatARepeatedReportWouldMiss) {
  Bench bench;
  bench.turn();
  std::uint64_t changes = bench.core.report().changes;
  const auto changed = [&] {
    return std::exchange(changes, bench.core.report().changes) != changes;
  };
  bench.turn();
  EXPECT_FALSE(changed());
  enable(bench);
  EXPECT_TRUE(changed());
  bench.run(3);
  EXPECT_FALSE(changed());
  stop(bench);
  EXPECT_TRUE(changed());
  stop(bench);
  EXPECT_FALSE(changed());
  ASSERT_TRUE(bench.reach(State::kVented));
  EXPECT_TRUE(changed());
  release(bench);
  EXPECT_TRUE(changed());
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
