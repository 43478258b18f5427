// What comes of time: silence, holding, venting, the slew and odd clocks.

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

TEST(SafetyTimes, ASilentCommanderIsAFaultBeyondItsTimeoutOnly) {
  Bench bench = enabledBench();
  bench.commands = false;
  bench.run(1);  // since the last target
  EXPECT_EQ(bench.state(), State::kEnabled);
  bench.turn();
  EXPECT_EQ(bench.cause(), Cause::kStaleTarget);
  EXPECT_EQ(bench.core.report().value, 1 + kTurn);
}

TEST(SafetyTimes, TheWatchdogOfTargetsBeginsAnewWithEveryEnabling) {
  Bench bench = enabledBench(0);
  bench.core.vent(bench.now);
  ASSERT_TRUE(bench.reach(State::kVented));
  bench.commands = false;
  bench.run(3);
  ASSERT_EQ(bench.core.enable(bench.now), "");
  bench.run(20);
  EXPECT_EQ(bench.state(), State::kEnabled);
  EXPECT_TRUE(bench.core.target(bench.now, bench.goal));
  bench.run(1 + kTurn);
  EXPECT_EQ(bench.cause(), Cause::kStaleTarget);
}

TEST(SafetyTimes, AnInfiniteTimeoutNeverExpires) {
  SafetyRules rules = test::benchRules();
  rules.target_timeout = kInfinity;
  Bench bench(rules);
  bench.turn();
  ASSERT_EQ(bench.core.enable(bench.now), "");
  bench.turn();
  bench.commands = false;
  bench.run(100);
  EXPECT_EQ(bench.state(), State::kEnabled);
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
  bench.readsAs(2, std::nan(""));
  bench.run(0.5);
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

TEST(SafetyTimes, AHeldChannelStaysAtItsSetPoint) {
  Bench bench(test::benchRules(), test::benchChannels(6.4e4));  // 1 kPa a turn
  bench.goal.setConstant(1e5);
  bench.turn();
  ASSERT_EQ(bench.core.enable(bench.now), "");
  bench.turns(42);
  const double before = bench.now;
  starve(bench);
  const double way = 6.4e4 * (bench.now - before) + 42e3;
  bench.run(2);
  ASSERT_EQ(bench.orders(), "vrc");
  EXPECT_NEAR(bench.core.orders().set_point[1], way, 2e3);
  EXPECT_LT(way, 6e4);
}

TEST(SafetyTimes, AVentIsOverdueWhilePressureRemainsAfterItsTime) {
  Bench bench = enabledBench();
  bench.readsAs(1, 5e4);
  bench.core.vent(bench.now);
  bench.run(3);
  EXPECT_FALSE(bench.core.report().vent_overdue);
  bench.turn();
  EXPECT_TRUE(bench.core.report().vent_overdue);
  EXPECT_NE(bench.core.reason().find("holds still reads 50.0 kPa"), std::string::npos)
      << bench.core.reason();
  bench.reads = false;  // and so it is where nobody knows
  bench.run(1);
  EXPECT_TRUE(bench.core.report().vent_overdue);
  bench.reads = true;
  bench.spoil = nullptr;
  bench.run(1);
  EXPECT_EQ(bench.state(), State::kVented);
  EXPECT_FALSE(bench.core.report().vent_overdue);
}

TEST(SafetyTimes, AHeldChannelIsOverdueOnlyAfterItsOwnVent) {
  Bench bench = enabledBench();
  starve(bench);
  bench.run(8);  // then what held begins to vent
  bench.readsAs(1, 5e4);
  bench.run(3);
  EXPECT_FALSE(bench.core.report().vent_overdue);
  bench.turn();
  EXPECT_TRUE(bench.core.report().vent_overdue);
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

TEST(SafetyTimes, ASetPointMovesByItsSlewAndAStalledLoopDoesNotJump) {
  Bench bench(test::benchRules(), test::benchChannels(2e5));
  bench.goal.setConstant(3e5);
  bench.turn();
  ASSERT_EQ(bench.core.enable(bench.now), "");
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

TEST(SafetyTimes, WithoutASlewASetPointIsAtItsGoalAtOnce) {
  Bench bench(test::benchRules(), test::benchChannels(kInfinity));
  bench.goal << 1e5, 2e5, 3e5;
  bench.turn();
  ASSERT_EQ(bench.core.enable(bench.now), "");
  bench.turn(0);
  EXPECT_EQ(bench.core.orders().set_point, bench.goal);
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

}  // namespace
}  // namespace helix_arm::control
