// Each rule from both sides of its threshold: what is read, what comes of time, and the way to
// rest.
#include <deque>

#include "support/random.hpp"
#include "support/refusal.hpp"
#include "support/safety_bench.hpp"

namespace helix_arm::control {
namespace {

using test::Bench;
using test::benchChannels;
using test::benchRules;
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
  SafetyRules rules = benchRules();
  Bench bench(rules, channels);
  bench.goal.setConstant(-5e4);
  bench.start().run(12);
  expectSpikeRule(Cause::kOverLimit, bench,
                  [](Bench& b, bool wrong) { b.readsAs(0, wrong ? below(-8e4) : -8e4); });
  // And a leak of it is a pressure that rises.
  expectSpikeRule(Cause::kLeak, bench,
                  [](Bench& b, bool wrong) { b.readsAs(0, wrong ? above(-2.5e4) : -2.5e4); });
}

TEST(SafetyRules, ALimitAboveTheAtmosphereIsNoFaultAndIsReachedByTheSlew) {
  std::vector<ChannelRules> channels = {{"kept_up", {5e4, 4e5}, 1e6, FaultAction::kVent}};
  Bench bench(benchRules(), channels);
  bench.goal.setZero();
  bench.run(5);
  ASSERT_EQ(bench.state(), State::kDisabled);
  ASSERT_EQ(bench.core.enable(bench.now), "");
  EXPECT_EQ(bench.core.orders().set_point[0], 0);
  EXPECT_EQ(bench.core.goal()[0], 5e4);
  for (int k = 1; k <= 3; ++k) {
    bench.turn();
    EXPECT_EQ(bench.core.orders().set_point[0], k * 1e6 * kTurn);
  }
  bench.run(5);
  EXPECT_EQ(bench.state(), State::kEnabled);
  EXPECT_EQ(bench.core.orders().set_point[0], 5e4);
}

TEST(SafetyRules, TheSupplyIsLowOnlyBelowItsLeastForTheSpikeTime) {
  expectSpikeRule(Cause::kLowSupply, enabledBench(),
                  [](Bench& bench, bool wrong) { bench.supply = wrong ? below(3.5e5) : 3.5e5; });
}

TEST(SafetyRules, APressureLeaksOnlyFurtherThanItsDropForTheSpikeTime) {
  expectSpikeRule(Cause::kLeak, enabledBench(), [](Bench& bench, bool wrong) {
    bench.readsAs(1, wrong ? below(1e5 - 2.5e4) : 1e5 - 2.5e4);
  });
}

TEST(SafetyRules, APressureThatHasNotStayedYetDoesNotLeak) {
  constexpr int kStay = 24;  // 1.5 time constants
  constexpr double kNear = 1.3e5 - 1.25e4;
  for (const auto& [near, stays] :
       {std::pair(kNear, kStay), {kNear, kStay + 1}, {below(kNear), 99}}) {
    Bench bench = enabledBench();
    const auto reads = [&](double value, int turns) { bench.readsAs(1, value).turns(turns); };
    bench.goal.setConstant(1.3e5);
    // The step of 30 kPa takes two turns; from then on the set point stands.
    reads(9.9e4, 4);
    ASSERT_EQ(bench.core.orders().set_point[1], 1.3e5);
    bench.readsAs(1, near).turns(stays - 2).readsAs(1, 9.9e4).turn().readsAs(1, near).turns(3);
    reads(9.9e4, kSpikeTurns + 1);
    EXPECT_EQ(bench.cause(), stays == kStay + 1 ? Cause::kLeak : Cause::kNone)
        << near << ", " << stays;
  }
}

// By up to 1.5 time constants; by any time where the set point waits for it.
TEST(SafetyRules, APressureThatComesLateIsNoLeak) {
  test::Random random(5);
  for (int delay = 0; delay < 64; ++delay) {  // turns: up to a second
    SafetyRules rules = benchRules();
    rules.follow_tolerance = 1e6;
    Bench bench(rules, {{"late", {0, 4e5}, delay % 2 ? kInfinity : 3e5, FaultAction::kVent}});
    std::deque<double> late(delay, 0.0);
    bench.spoil = [&](Eigen::VectorXd& reading) {
      late.push_back(reading[0] + 3e3 * random.normal());
      reading[0] = late.front();
      late.pop_front();
    };
    bench.start();
    for (int k = 0; k < 500 && bench.state() == State::kEnabled; ++k) {
      bench.goal.setConstant(random.uniform(0, 4e5));
      bench.turns(random.integer(1, 16) + (delay > 24 ? delay : 0));
    }
    EXPECT_EQ(bench.state(), State::kEnabled) << delay << ": " << bench.core.reason();
  }
}

TEST(SafetyRules, ASetPointThatTremblesHidesNoLeakAndOneThatMovesHasNone) {
  for (const double move : {4e3, 6e3}) {  // a fifth of leak_drop is 5 kPa
    Bench bench = enabledBench();
    bench.readsAs(1, 7e4);
    for (int k = 0; k < 20; ++k) {
      bench.goal.setConstant(1e5 + move * (k % 2));
      bench.turn();
    }
    EXPECT_EQ(bench.cause(), move < 5e3 ? Cause::kLeak : Cause::kNone) << move;
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
    bench.readsAs(1, above(4.3e5)).turn();
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

TEST(SafetyRules, AChannelMustComeAsFarAsALagOfItsSetPoint) {
  // r(t) = p (1 - exp(-t / tau)) after a step to p.
  for (const double off : {4e4 - 1, -(4e4 - 1), 4e4 + 1, -(4e4 + 1)}) {
    SafetyRules rules = benchRules();
    Bench bench(rules, {{"muscle", {0, 4e5}, kInfinity, FaultAction::kHold}});
    bench.goal.setConstant(3e5);
    bench.start().turn();
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

TEST(SafetyTimes, ASilentCommanderIsAFaultBeyondItsTimeoutOnly) {
  Bench bench = enabledBench();
  bench.silent().run(1);  // since the last target
  EXPECT_EQ(bench.state(), State::kEnabled);
  bench.turn();
  EXPECT_EQ(bench.cause(), Cause::kStaleTarget);
  EXPECT_EQ(bench.core.report().value, 1 + kTurn);
}

TEST(SafetyTimes, TheWatchdogOfTargetsBeginsAnewWithEveryEnabling) {
  Bench bench = enabledBench(0);
  bench.core.vent(bench.now);
  ASSERT_TRUE(bench.reach(State::kVented));
  bench.silent().run(3);
  ASSERT_EQ(bench.core.enable(bench.now), "");
  bench.run(20);
  EXPECT_EQ(bench.state(), State::kEnabled);
  EXPECT_TRUE(bench.core.target(bench.now, bench.goal));
  bench.run(1 + kTurn);
  EXPECT_EQ(bench.cause(), Cause::kStaleTarget);
}

TEST(SafetyTimes, ATargetThatSaysNothingIsNone) {
  Bench bench = enabledBench();
  bench.commands = false;
  const Eigen::Vector3d nothing = Eigen::Vector3d::Constant(std::nan(""));
  const Eigen::Vector2d wrong_size = Eigen::Vector2d::Constant(2e5);
  for (int k = 0; k < 64; ++k) {
    bench.turn();
    EXPECT_FALSE(bench.core.target(bench.now, nothing));
    EXPECT_FALSE(bench.core.target(bench.now, wrong_size));
  }
  bench.turn();
  EXPECT_EQ(bench.cause(), Cause::kStaleTarget);
  EXPECT_EQ(bench.core.goal()[0], 0);  // this one vents
  EXPECT_EQ(bench.core.goal()[1], 1e5);
}

TEST(SafetyTimes, EachChannelMustBeReadWithinItsTimeout) {
  Bench bench = enabledBench();
  bench.readsAs(2, std::nan("")).run(0.5);
  EXPECT_EQ(bench.state(), State::kEnabled);
  bench.turn();
  EXPECT_EQ(bench.cause(), Cause::kStaleReading);
  EXPECT_EQ(bench.core.report().channel, 2);
  EXPECT_EQ(bench.core.report().value, 0.5 + kTurn);

  Bench blind = enabledBench();
  blind.reads = false;
  const Eigen::VectorXd wrong_size = Eigen::VectorXd::Zero(2);
  for (int k = 0; k < 33; ++k) {
    blind.turn();
    blind.core.measured(blind.now, wrong_size, 5e5);
  }
  EXPECT_EQ(blind.cause(), Cause::kStaleReading);
}

TEST(SafetyTimes, AChannelThatAnswersInTurnsIsRead) {
  Bench bench = enabledBench();
  int k = 0;
  bench.spoil = [&](Eigen::VectorXd& reading) {
    for (int i = 0; i < 3; ++i) {
      if (i != k % 3) reading[i] = std::nan("");
    }
    ++k;
  };
  bench.run(10);
  EXPECT_EQ(bench.state(), State::kEnabled);
  EXPECT_EQ(bench.core.reading(), bench.pressure);  // the newest of each, and they stand
}

// A fault in which every channel does what its action says.
void starve(Bench& bench) {
  bench.supply = 1e5;
  ASSERT_TRUE(bench.reach(State::kFault));
}

TEST(SafetyTimes, ChannelsAreHeldOnlyForTheHoldTime) {
  Bench bench = enabledBench();
  starve(bench);
  const double begin = bench.now;
  const double held = bench.core.orders().set_point[1];
  while (bench.now < begin + 8 - kTurn) {
    bench.turn();
    ASSERT_EQ(bench.orders(), "vrc");
    ASSERT_EQ(bench.core.orders().set_point[1], held);
  }
  bench.turn();
  EXPECT_EQ(bench.now, begin + 8);
  EXPECT_EQ(bench.orders(), "vvv");
  EXPECT_TRUE(bench.core.orders().set_point.isZero());
}

TEST(SafetyTimes, AVentIsOverdueWhilePressureRemainsAfterItsTime) {
  Bench bench = enabledBench();
  bench.readsAs(1, 5e4);
  bench.core.vent(bench.now);
  bench.run(3);
  EXPECT_FALSE(bench.core.report().vent_overdue);
  bench.turn();
  EXPECT_TRUE(bench.core.report().vent_overdue);
  EXPECT_EQ(bench.core.reason(),
            "fault: a vent was requested: all channels vent; holds still reads 50.0 kPa, 3.0 s "
            "after it began to vent (safety.vent_time_s is 3): shut the supply and open the relief "
            "valve by hand; call enable to continue");
  bench.reads = false;  // and so it is where nobody knows
  bench.run(1);
  EXPECT_TRUE(bench.core.report().vent_overdue);
  bench.reads = true;
  bench.spoil = nullptr;
  bench.run(1);
  EXPECT_EQ(bench.state(), State::kVented);
  EXPECT_FALSE(bench.core.report().vent_overdue);
}

TEST(SafetyTimes, ReturningPressureRestartsTheVentTime) {
  Bench bench = enabledBench();
  bench.core.vent(bench.now);
  ASSERT_TRUE(bench.reach(State::kVented));
  bench.run(10);
  bench.readsAs(1, 5e4);
  ASSERT_TRUE(bench.reach(State::kFault));
  bench.run(3);
  EXPECT_FALSE(bench.core.report().vent_overdue);
  bench.turn();
  EXPECT_TRUE(bench.core.report().vent_overdue);
}

TEST(SafetyTimes, AHeldChannelIsOverdueOnlyAfterItsOwnVent) {
  Bench bench = enabledBench();
  starve(bench);
  bench.run(8);  // then what held begins to vent
  bench.readsAs(1, 5e4).run(3);
  EXPECT_FALSE(bench.core.report().vent_overdue);
  bench.turn();
  EXPECT_TRUE(bench.core.report().vent_overdue);
}

TEST(SafetyTimes, ASetPointMovesByItsSlewAndAStalledLoopDoesNotJump) {
  Bench bench(benchRules(), benchChannels(2e5));
  bench.goal.setConstant(3e5);
  bench.start();
  EXPECT_TRUE(bench.core.orders().set_point.isZero());
  bench.turn();
  EXPECT_EQ(bench.core.orders().set_point[0], 2e5 * kTurn);
  bench.turn(3 * kTurn);
  EXPECT_EQ(bench.core.orders().set_point[0], 2e5 * 4 * kTurn);
  const double before = bench.core.orders().set_point[0];
  bench.turn(0.4);  // below every timeout
  EXPECT_NEAR(bench.core.orders().set_point[0] - before, 2e5 * 0.1, 1e-6);
  bench.run(3);
  EXPECT_EQ(bench.core.orders().set_point[0], 3e5);
  bench.goal.setConstant(0);
  bench.turn();
  EXPECT_EQ(bench.core.orders().set_point[0], 3e5 - 2e5 * kTurn);
}

TEST(SafetyTimes, TargetsAreClampedAndGapsInThemStay) {
  Bench bench = enabledBench();
  bench.core.target(bench.now, Eigen::Vector3d(9e9, -1, std::nan("")));
  EXPECT_EQ(bench.core.goal(), Eigen::Vector3d(4e5, 0, 1e5));
  bench.core.target(bench.now, Eigen::Vector3d(-kInfinity, 2e5, kInfinity));
  EXPECT_EQ(bench.core.goal(), Eigen::Vector3d(4e5, 2e5, 1e5));
}

TEST(SafetyTimes, AClockThatGoesBackOrIsNaNStandsStill) {
  Bench bench = enabledBench();
  bench.goal.setConstant(2e5);
  bench.turn();
  const Eigen::VectorXd before = bench.core.orders().set_point;
  for (const double now : {bench.now - 100, std::nan(""), kInfinity, -kInfinity}) {
    bench.core.target(now, bench.goal);
    bench.core.measured(now, bench.pressure, 5e5);
    EXPECT_EQ(bench.core.advance(now).set_point, before);
    EXPECT_EQ(bench.state(), State::kEnabled);
  }
  bench.turn();
  EXPECT_NEAR(bench.core.orders().set_point[0] - before[0], 1e6 * kTurn, 1e-6);
}

// ---- A commander that is done: the arm ramps down and rests, and nothing of that is a fault ----

constexpr double kSlowSlew = 6.4e4;  // 1 kPa a turn [Pa/s]

// Its commander is done.
Bench restingBench(std::vector<ChannelRules> channels = benchChannels()) {
  Bench bench = enabledBench(1e5, std::move(channels));
  bench.commands = false;
  EXPECT_TRUE(bench.core.rest(bench.now));
  return bench;
}

TEST(SafetyRest, WithoutASlewItVentsOnceTheReadingsAreDown) {
  Bench bench = restingBench(benchChannels(kInfinity));
  bench.turn();
  EXPECT_TRUE(bench.core.orders().set_point.isZero());
  EXPECT_EQ(bench.orders(), "rrr");
  bench.readsAs(2, 1.01e4);  // just not empty
  bench.run(1.5);
  EXPECT_EQ(bench.state(), State::kEnabled);
  bench.readsAs(2, 0.99e4).turn();
  EXPECT_EQ(bench.state(), State::kDisabled);
}

TEST(SafetyRest, ATargetContinuesFromTheRamp) {
  Bench bench = restingBench(benchChannels(kSlowSlew));
  bench.turns(30);
  bench.core.target(bench.now, Eigen::Vector3d(2e5, std::nan(""), 0));
  EXPECT_EQ(bench.core.goal(), Eigen::Vector3d(2e5, 0, 0));
  bench.turn();
  EXPECT_NEAR(bench.core.orders().set_point[0], 7.1e4, 1e-6);
  EXPECT_NEAR(bench.core.orders().set_point[2], 6.9e4, 1e-6);
  // From then on its silence counts again.
  bench.run(1 - kTurn);
  EXPECT_EQ(bench.state(), State::kEnabled);
  bench.turn();
  EXPECT_EQ(bench.cause(), Cause::kStaleTarget);
}

TEST(SafetyRest, WhatATargetLeavesOutReturnsInsideItsLimits) {
  std::vector<ChannelRules> channels = benchChannels(kSlowSlew);
  channels[1].limits.lower = 5e4;
  Bench bench = restingBench(channels);
  bench.run(1);
  ASSERT_LT(bench.core.orders().set_point[1], 5e4);
  ASSERT_EQ(bench.state(), State::kEnabled);
  bench.core.target(bench.now, Eigen::Vector3d(1e5, std::nan(""), std::nan("")));
  EXPECT_EQ(bench.core.goal(), Eigen::Vector3d(1e5, 5e4, 0));
}

TEST(SafetyRest, PressureAfterTheVentTimeIsAFaultThatVents) {
  Bench bench = restingBench(benchChannels(kSlowSlew));
  bench.turns(100);  // the ramp
  bench.readsAs(1, 2e4).run(3);
  EXPECT_EQ(bench.state(), State::kEnabled);
  bench.turn();
  EXPECT_EQ(bench.cause(), Cause::kNotVenting);
  EXPECT_EQ(bench.core.report().channel, 1);
  EXPECT_EQ(bench.orders(), "vvv");
  bench.run(3);
  EXPECT_FALSE(bench.core.report().vent_overdue);
  bench.turn();
  EXPECT_TRUE(bench.core.report().vent_overdue);
  EXPECT_FALSE(bench.core.mayEnableItself());
}

TEST(SafetyRest, ACancelledRampRestartsItsVentTime) {
  Bench bench = restingBench();
  bench.readsAs(1, 2e4).run(2.5);
  ASSERT_EQ(bench.state(), State::kEnabled);
  bench.core.target(bench.now, Eigen::Vector3d::Zero());
  bench.turn();
  ASSERT_TRUE(bench.core.rest(bench.now));
  bench.run(2.5);
  EXPECT_EQ(bench.state(), State::kEnabled);
  bench.run(1);
  EXPECT_EQ(bench.cause(), Cause::kNotVenting);
}

// Noise shows a channel empty whose last pressure is leaving; what stands for longer is a fault.
TEST(SafetyRest, PressureThatStillLeavesIsNoFaultAndOneThatComesBackIs) {
  for (const bool leaves : {true, false}) {
    Bench bench = restingBench();
    double reads = 2e4;
    bench.spoil = [&reads](Eigen::VectorXd& reading) {
      reading.setZero();
      reading[1] = reads;
    };
    bench.run(1);
    ASSERT_EQ(bench.state(), State::kEnabled);
    reads = 0;
    bench.turn();
    ASSERT_EQ(bench.state(), State::kDisabled);
    if (leaves) {
      reads = 1.2e4;
      bench.run(0.5 * benchRules().vent_time);
      EXPECT_EQ(bench.state(), State::kDisabled) << bench.core.reason();
      bench.run(0.6 * benchRules().vent_time);
    } else {
      bench.run(2 * benchRules().spike_time);
      reads = 1.2e4;
      bench.run(2 * benchRules().spike_time);
    }
    EXPECT_EQ(bench.cause(), Cause::kNotVenting);
  }
}

}  // namespace
}  // namespace helix_arm::control
