// A commander that is done: the arm ramps down and rests, and nothing of that is a fault.

#include <cmath>
#include <limits>

#include <gtest/gtest.h>

#include "support/allocation_counter.hpp"
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
constexpr double kSlowSlew = 6.4e4;  // 1 kPa a turn [Pa/s]

// Its commander is done.
Bench restingBench(std::vector<ChannelRules> channels = benchChannels()) {
  Bench bench = enabledBench(1e5, std::move(channels));
  bench.commands = false;
  EXPECT_TRUE(bench.core.rest(bench.now));
  return bench;
}

TEST(SafetyRest, SetPointsRampDownAtTheirSlewAndTheArmThenRestsWithoutACause) {
  Bench bench = restingBench(benchChannels(kSlowSlew));
  for (int k = 1; k <= 100; ++k) {
    bench.turn();
    ASSERT_EQ(bench.orders(), "rrr");
    for (const double set_point : bench.core.orders().set_point) {
      ASSERT_NEAR(set_point, 1e5 - 1e3 * k, 1e-6);
    }
  }
  ASSERT_TRUE(bench.reach(State::kDisabled)) << bench.core.reason();
  EXPECT_EQ(bench.cause(), Cause::kNone);
  EXPECT_EQ(bench.orders(), "vvv");
  EXPECT_LE(bench.pressure.maxCoeff(), benchRules().vented_below);
  EXPECT_FALSE(bench.core.report().vent_overdue);
  EXPECT_TRUE(bench.core.mayEnableItself());
}

TEST(SafetyRest, AllChangesAreCounted) {
  Bench bench = enabledBench();
  bench.commands = false;
  const std::uint64_t before = bench.core.report().changes;
  EXPECT_TRUE(bench.core.rest(bench.now));
  EXPECT_EQ(bench.core.report().changes, before + 1);
  EXPECT_TRUE(bench.core.report().resting);
  EXPECT_TRUE(bench.core.rest(bench.now));
  EXPECT_EQ(bench.core.report().changes, before + 1);
  bench.core.target(bench.now, bench.goal);
  EXPECT_EQ(bench.core.report().changes, before + 2);
  EXPECT_FALSE(bench.core.report().resting);
  EXPECT_TRUE(bench.core.rest(bench.now));
  ASSERT_TRUE(bench.reach(State::kDisabled));
  EXPECT_EQ(bench.core.report().changes, before + 4);
  EXPECT_FALSE(bench.core.report().resting);
}

// A ramp that takes longer than the silence that a commander may keep.
TEST(SafetyRest, TheSilenceOfTheCommanderIsNoFaultHoweverLongTheRamp) {
  Bench bench = restingBench(benchChannels(1e4));
  bench.run(9.5);
  EXPECT_EQ(bench.state(), State::kEnabled);
  EXPECT_GT(bench.core.orders().set_point.minCoeff(), 0);
  EXPECT_TRUE(bench.reach(State::kDisabled)) << bench.core.reason();
}

TEST(SafetyRest, AnEmptyArmRestsAtOnce) {
  Bench bench = enabledBench(0);
  ASSERT_TRUE(bench.core.rest(bench.now));
  bench.core.advance(bench.now);
  EXPECT_EQ(bench.state(), State::kDisabled);
}

TEST(SafetyRest, WithoutASlewItVentsOnceTheReadingsAreDown) {
  Bench bench = restingBench(benchChannels(kInfinity));
  bench.turn();
  EXPECT_TRUE(bench.core.orders().set_point.isZero());
  EXPECT_EQ(bench.orders(), "rrr");
  bench.readsAs(2, 1.01e4);  // just not empty
  bench.run(1.5);
  EXPECT_EQ(bench.state(), State::kEnabled);
  bench.readsAs(2, 0.99e4);
  bench.turn();
  EXPECT_EQ(bench.state(), State::kDisabled);
}

// Muscles that are never to be empty while they regulate, and those that are evacuated.
TEST(SafetyRest, LimitsThatExcludeTheAtmosphereAreLeftForIt) {
  for (const model::Range& limits : {model::Range{5e4, 4e5}, model::Range{-6e4, -2e4}}) {
    Bench bench(benchRules(), {{"muscle", limits, kSlowSlew, FaultAction::kVent}});
    bench.goal.setConstant(limits.lower + 1e4);
    bench.turn();
    ASSERT_EQ(bench.core.enable(bench.now), "");
    bench.run(4);
    ASSERT_EQ(bench.core.orders().set_point, bench.goal);
    bench.commands = false;
    ASSERT_TRUE(bench.core.rest(bench.now));
    double before = std::abs(bench.core.orders().set_point[0]);
    while (before > 0) {
      bench.turn();
      const double now = std::abs(bench.core.orders().set_point[0]);
      ASSERT_NEAR(now, std::max(before - 1e3, 0.0), 1e-6);
      before = now;
    }
    EXPECT_TRUE(bench.reach(State::kDisabled)) << bench.core.reason();
  }
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

TEST(SafetyRest, ATargetThatSaysNothingCancelsNothing) {
  Bench bench = restingBench();
  EXPECT_FALSE(bench.core.target(bench.now, Eigen::Vector3d::Constant(std::nan(""))));
  EXPECT_FALSE(bench.core.target(bench.now, Eigen::Vector2d(1e5, 1e5)));
  EXPECT_TRUE(bench.core.report().resting);
  EXPECT_TRUE(bench.reach(State::kDisabled));
}

TEST(SafetyRest, PressureAfterTheVentTimeIsAFaultThatVents) {
  Bench bench = restingBench(benchChannels(kSlowSlew));
  bench.turns(100);  // the ramp
  bench.readsAs(1, 2e4);
  bench.run(3);
  EXPECT_EQ(bench.state(), State::kEnabled);
  bench.turn();
  EXPECT_EQ(bench.cause(), Cause::kNotVenting);
  EXPECT_EQ(bench.core.report().channel, 1);
  EXPECT_EQ(bench.orders(), "vvv");
  EXPECT_EQ(bench.core.reason(),
            "fault: holds reads 20.0 kPa although it should be empty, more than 10 kPa from the "
            "atmosphere (safety.vented_below_kpa): all channels vent; shut the supply and check "
            "for a valve that does not close, then call enable");
  bench.run(3);
  EXPECT_FALSE(bench.core.report().vent_overdue);
  bench.turn();
  EXPECT_TRUE(bench.core.report().vent_overdue);
  EXPECT_FALSE(bench.core.mayEnableItself());
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

TEST(SafetyRest, ACancelledRampRestartsItsVentTime) {
  Bench bench = restingBench();
  bench.readsAs(1, 2e4);
  bench.run(2.5);
  ASSERT_EQ(bench.state(), State::kEnabled);
  bench.core.target(bench.now, Eigen::Vector3d::Zero());
  bench.turn();
  ASSERT_TRUE(bench.core.rest(bench.now));
  bench.run(2.5);
  EXPECT_EQ(bench.state(), State::kEnabled);
  bench.run(1);
  EXPECT_EQ(bench.cause(), Cause::kNotVenting);
}

TEST(SafetyRest, NewRulesAreTakenOnTheRamp) {
  std::vector<ChannelRules> channels = benchChannels(kSlowSlew);
  for (ChannelRules& channel : channels) channel.limits.lower = 5e4;
  Bench bench = restingBench(channels);
  channels[0].limits.upper = 1.5e5;
  EXPECT_EQ(test::refusal([&] { bench.core.adopt(channels, benchRules()); }), "accepted");
  EXPECT_TRUE(bench.reach(State::kDisabled)) << bench.core.reason();
}

TEST(SafetyRest, NothingAllocates) {
  Bench bench = enabledBench();
  bench.commands = false;
  const test::AllocationCounter counter;
  for (int k = 0; k < 200; ++k) {
    bench.now += kTurn;
    bench.core.rest(bench.now);
    if (k == 5) bench.core.target(bench.now, bench.goal);
    bench.pressure *= 0.9;
    bench.core.measured(bench.now, bench.pressure, 5e5);
    bench.core.advance(bench.now);
  }
  EXPECT_EQ(counter.count(), 0u);
  EXPECT_EQ(bench.state(), State::kDisabled);
}

}  // namespace
}  // namespace helix_arm::control
