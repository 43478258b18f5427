// What is read, against each rule and from both sides of its threshold.

#include <cmath>
#include <limits>

#include <gtest/gtest.h>

#include "support/safety_bench.hpp"

namespace helix_arm::control {
namespace {

using test::Bench;
using test::enabledBench;
using test::kTurn;
using State = SafetyState;
using Cause = SafetyCause;

constexpr double kInfinity = std::numeric_limits<double>::infinity();
constexpr int kSpikeTurns = 8;  // of the bench's spike time

double above(double x) { return std::nextafter(x, kInfinity); }
double below(double x) { return std::nextafter(x, -kInfinity); }

// A rule on readings: at its limit there is no fault; beyond it there is one after the spike time;
// this number of good readings in between restarts the time.
void expectLastingRule(Cause cause, Bench bench, int good,
                       const std::function<void(Bench&, bool wrong)>& set) {
  SCOPED_TRACE(nameOf(cause));
  const State before = bench.state();
  set(bench, false);
  bench.turns(5 * kSpikeTurns);
  EXPECT_EQ(bench.state(), before) << bench.core.reason();
  for (int repeat = 0; repeat < 3; ++repeat) {
    set(bench, true);
    bench.turns(kSpikeTurns);
    EXPECT_EQ(bench.state(), before) << bench.core.reason();
    set(bench, false);
    bench.turns(good);
  }
  set(bench, true);
  bench.turns(kSpikeTurns + 1);  // so many readings span the spike time
  EXPECT_EQ(bench.state(), State::kFault);
  EXPECT_EQ(bench.cause(), cause);
}

// Such a rule that adds up: spikes are no fault however often they come, what flickers is.
void expectSpikeRule(Cause cause, Bench bench, const std::function<void(Bench&, bool wrong)>& set) {
  expectLastingRule(cause, bench, 2 * kSpikeTurns, set);
  SCOPED_TRACE(nameOf(cause));
  const State before = bench.state();
  for (int turn = 0; turn < 30 * kSpikeTurns; ++turn) {
    set(bench, turn % 3 == 0);
    bench.turn();
    ASSERT_EQ(bench.state(), before) << "spikes, turn " << turn;
  }
  int turns = 0;
  for (; bench.state() == before && turns < 30 * kSpikeTurns; ++turns) {
    set(bench, turns % 2 == 0);
    bench.turn();
  }
  EXPECT_EQ(bench.cause(), cause);
  EXPECT_EQ(turns, 4 * kSpikeTurns + 1);  // each pair of them adds half a turn
}

TEST(SafetyRules, APressureIsOverOnlyAboveLimitAndMarginForTheSpikeTime) {
  // At its upper limit: what it reads is no sign of anything else.
  expectSpikeRule(Cause::kOverLimit, enabledBench(4e5),
                  [](Bench& bench, bool wrong) { bench.readsAs(1, wrong ? above(4.3e5) : 4.3e5); });
}

TEST(SafetyRules, AnEvacuatedChannelIsOverBelowItsLowerLimit) {
  std::vector<ChannelRules> channels = {{"vacuum", {-5e4, 0}, kInfinity, FaultAction::kHold}};
  SafetyRules rules = test::benchRules();
  Bench bench(rules, channels);
  bench.goal.setConstant(-5e4);
  bench.turn();
  ASSERT_EQ(bench.core.enable(bench.now), "");
  bench.run(12);
  expectSpikeRule(Cause::kOverLimit, bench,
                  [](Bench& b, bool wrong) { b.readsAs(0, wrong ? below(-8e4) : -8e4); });
  // And a leak of it is a pressure that rises.
  expectSpikeRule(Cause::kLeak, bench,
                  [](Bench& b, bool wrong) { b.readsAs(0, wrong ? above(-2.5e4) : -2.5e4); });
}

TEST(SafetyRules, ALimitAboveTheAtmosphereIsNoFaultAndIsReachedByTheSlew) {
  std::vector<ChannelRules> channels = {{"kept_up", {5e4, 4e5}, 1e6, FaultAction::kVent}};
  Bench bench(test::benchRules(), channels);
  bench.goal.setZero();
  bench.run(5);
  ASSERT_EQ(bench.state(), State::kDisabled);
  ASSERT_EQ(bench.core.enable(bench.now), "");
  EXPECT_EQ(bench.core.orders().set_point[0], 0);
  EXPECT_EQ(bench.core.goal()[0], 5e4);
  for (int k = 1; k <= 3; ++k) {
    bench.turn();
    EXPECT_EQ(bench.core.orders().set_point[0], k * 1e6 * test::kTurn);
  }
  bench.run(5);
  EXPECT_EQ(bench.state(), State::kEnabled);
  EXPECT_EQ(bench.core.orders().set_point[0], 5e4);
}

TEST(SafetyRules, TheSupplyIsLowOnlyBelowItsLeastForTheSpikeTime) {
  expectSpikeRule(Cause::kLowSupply, enabledBench(),
                  [](Bench& bench, bool wrong) { bench.supply = wrong ? below(3.5e5) : 3.5e5; });
}

TEST(SafetyRules, AnUnwatchedSupplyMayBeLowOrUnread) {
  SafetyRules rules = test::benchRules();
  rules.min_supply.reset();
  for (const double supply : {0.0, std::nan("")}) {
    Bench bench(rules);
    bench.supply = supply;
    bench.turn();
    ASSERT_EQ(bench.core.enable(bench.now), "");
    bench.run(3);
    EXPECT_EQ(bench.state(), State::kEnabled) << supply;
  }
}

TEST(SafetyRules, APressureLeaksOnlyFurtherThanItsDropForTheSpikeTime) {
  expectSpikeRule(Cause::kLeak, enabledBench(), [](Bench& bench, bool wrong) {
    bench.readsAs(1, wrong ? below(1e5 - 2.5e4) : 1e5 - 2.5e4);
  });
}

TEST(SafetyRules, APressureThatHasNotArrivedYetDoesNotLeak) {
  for (const bool arrives : {false, true}) {
    Bench bench = enabledBench();
    const auto reads = [&](double value, int turns) {
      bench.readsAs(1, value);
      bench.turns(turns);
    };
    bench.goal.setConstant(1.3e5);
    // The step of 30 kPa takes two turns; from then on the set point stands.
    reads(9.9e4, 4);
    ASSERT_EQ(bench.core.orders().set_point[1], 1.3e5);
    reads(arrives ? 1.3e5 - 1.25e4 : below(1.3e5 - 1.25e4), 1);
    reads(9.9e4, kSpikeTurns + 1);
    EXPECT_EQ(bench.cause(), arrives ? Cause::kLeak : Cause::kNone);
  }
}

TEST(SafetyRules, ASetPointThatTremblesHidesNoLeak) {
  Bench bench = enabledBench();
  bench.readsAs(1, 7e4);
  for (int k = 0; k < 20; ++k) {
    bench.goal.setConstant(1e5 + 4e3 * (k % 2));
    bench.turn();
  }
  EXPECT_EQ(bench.cause(), Cause::kLeak);
}

TEST(SafetyRules, ASetPointThatMovesIsNoLeak) {
  Bench bench = enabledBench();
  for (int k = 0; k < 20; ++k) {
    bench.goal.setConstant(1e5 + 6e3 * (k % 2));  // by more than a fifth of leak_drop
    bench.readsAs(1, 7e4);
    bench.turn();
    ASSERT_EQ(bench.state(), State::kEnabled);
  }
}

TEST(SafetyRules, PressureRemainsOnlyIfAboveVentedBelowForTheSpikeTime) {
  for (const double sign : {1.0, -1.0}) {
    Bench bench = enabledBench(0);
    bench.core.vent(bench.now);
    ASSERT_TRUE(bench.reach(State::kVented));
    // The noise of an arm that is almost empty does not add up.
    expectLastingRule(Cause::kNotVenting, bench, 1, [=](Bench& b, bool wrong) {
      b.readsAs(1, sign * (wrong ? above(1e4) : 1e4));
    });
  }
}

TEST(SafetyRules, TimeWithoutReadingsHardlyCountsAfterASpike) {
  Bench bench = enabledBench(4e5);
  const auto spike = [&bench] {
    bench.readsAs(1, above(4.3e5));
    bench.turn();
    bench.readsAs(1, 4.3e5);
  };
  spike();
  bench.reads = false;
  bench.turns(2 * kSpikeTurns);
  bench.reads = true;
  bench.turn();
  spike();
  EXPECT_EQ(bench.state(), State::kEnabled) << bench.core.reason();
}

TEST(SafetyRules, AFaultEndsOnceReadingsShowNoPressure) {
  for (const bool empty : {false, true}) {
    Bench bench = enabledBench();
    bench.readsAs(1, empty ? 1e4 : above(1e4));
    bench.core.vent(bench.now);
    bench.run(5);
    EXPECT_EQ(bench.state(), empty ? State::kVented : State::kFault);
  }
}

TEST(SafetyRules, AChannelMustComeAsFarAsALagOfItsSetPoint) {
  // r(t) = p (1 - exp(-t / tau)) after a step to p.
  for (const double off : {4e4 - 1, -(4e4 - 1), 4e4 + 1, -(4e4 + 1)}) {
    SafetyRules rules = test::benchRules();
    Bench bench(rules, {{"muscle", {0, 4e5}, kInfinity, FaultAction::kHold}});
    bench.goal.setConstant(3e5);
    bench.turn();
    ASSERT_EQ(bench.core.enable(bench.now), "");
    bench.turn();
    const double step_at = bench.now;
    bench.spoil = [&](Eigen::VectorXd& reading) {
      const double t = bench.now - step_at;
      reading[0] = 3e5 * (1 - std::exp(-t / 0.25)) + off;
    };
    bench.run(1);
    EXPECT_EQ(bench.state(), State::kEnabled) << off;
    bench.run(0.5);
    const bool wrong = std::abs(off) > 4e4;
    // A reading that stays that far below a pressure that stands has not arrived: no leak.
    EXPECT_STREQ(nameOf(bench.cause()), nameOf(wrong ? Cause::kNotFollowing : Cause::kNone)) << off;
    EXPECT_NEAR(bench.core.report().value, wrong ? std::abs(off) : 0, 1e-6);
  }
}

TEST(SafetyRules, ASlowTurnKnowsTheLagAsWellAsManyFastOnes) {
  for (const double dt : {kTurn, 0.25}) {
    Bench bench(test::benchRules(), {{"muscle", {0, 4e5}, kInfinity, FaultAction::kVent}});
    bench.turn();
    ASSERT_EQ(bench.core.enable(bench.now), "");
    bench.goal.setConstant(3e5);
    bench.turn();
    while (bench.now < 1000 + 2 * kTurn + 2) {
      bench.turn(dt);  // the bench's channels are lags, integrated by the same steps
      ASSERT_EQ(bench.state(), State::kEnabled);
    }
  }
}

}  // namespace
}  // namespace helix_arm::control
