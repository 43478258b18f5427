// The core as a whole: its rules, new ones while it runs, and why it refuses to be enabled.
#include "support/allocation_counter.hpp"
#include "support/has.hpp"
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

constexpr double kNan = std::numeric_limits<double>::quiet_NaN();

// What a healthy rig reads: lags, noise of 5 kPa, a hundred readings a second.
TEST(SafetyCoreAsAWhole, TheDefaultsWorkThroughNoiseForAnHour) {
  constexpr double kDt = 0.01;
  test::Random random(2026);
  std::vector<ChannelRules> channels;
  for (const char* name : {"muscle_1", "muscle_2", "muscle_3"}) {
    channels.push_back({name, {0, 4e5}, 5e5, FaultAction::kVent});
  }
  SafetyRules rules;
  rules.min_supply = 4.8e5;
  SafetyCore core(channels, rules);
  Eigen::Vector3d pressure = Eigen::Vector3d::Zero(), goal = Eigen::Vector3d::Zero(), reading;
  const Eigen::Vector3d lag(0.1, 0.15, 0.25);  // none of them quite what the rules say
  double now = 0;
  int refused = 0;
  const auto turn = [&] {
    now += kDt;
    for (int i = 0; i < 3; ++i) {
      pressure[i] += -std::expm1(-kDt / lag[i]) * (core.orders().set_point[i] - pressure[i]);
      reading[i] = pressure[i] + 5e3 * random.normal();
    }
    core.measured(now, reading, 5e5 + 5e3 * random.normal());
    core.advance(now);
  };
  for (int k = 0; k < 1000; ++k) {
    turn();
    if (k > 20 && !core.refusal(now).empty()) ++refused;
  }
  EXPECT_EQ(refused, 0);
  ASSERT_EQ(core.enable(now), "");
  int moves = 0;
  for (int k = 0; k < 360000; ++k) {
    if (k % 200 == 0) {  // steps of any size, and some stand for long
      for (int i = 0; i < 3; ++i) {
        if (random.uniform(0, 1) < 0.5) goal[i] = random.uniform(0, 4e5);
      }
      ++moves;
    }
    core.target(now, goal);
    turn();
    ASSERT_EQ(core.state(), State::kEnabled) << core.reason();
  }
  EXPECT_EQ(moves, 1800);
  // It ends in peace as well: what is vented is seen to be, and stays so.
  core.vent(now);
  for (int k = 0; k < 360000; ++k) {
    turn();
    ASSERT_TRUE(k < 200 || core.state() == State::kVented) << core.reason();
  }
}

TEST(SafetyCoreAsAWhole, NothingAllocatesDuringAFaultOrOnTheWayToRest) {
  const Eigen::VectorXd none = Eigen::VectorXd::Constant(3, kNan);
  const Eigen::VectorXd high = Eigen::VectorXd::Constant(3, 5e5);
  for (const bool rests : {false, true}) {
    Bench bench = enabledBench();
    const test::AllocationCounter counter;
    for (int k = 0; k < 200; ++k) {
      bench.now += kTurn;
      bench.core.linked(bench.now, true);
      if (rests) bench.core.rest(bench.now);
      if (rests) bench.pressure *= 0.9;
      if (!rests || k == 5) bench.core.target(bench.now, k % 3 == 0 ? none : bench.goal);
      bench.core.measured(bench.now, rests || k < 100 ? bench.pressure : high, 5e5);
      bench.core.advance(bench.now);
    }
    EXPECT_STREQ(nameOf(bench.cause()), nameOf(rests ? Cause::kNone : Cause::kOverLimit));
    EXPECT_STREQ(nameOf(bench.state()), nameOf(rests ? State::kDisabled : State::kFault));
    bench.core.linked(bench.now, false);
    bench.core.emergencyStop(bench.now, true);
    bench.core.vent(bench.now);
    bench.core.advance(bench.now);
    EXPECT_EQ(counter.count(), 0u);
  }
}

TEST(SafetyAdopt, OrdersGoOnUnderNewRules) {
  Bench bench = enabledBench();
  std::vector<ChannelRules> channels = benchChannels();
  for (ChannelRules& channel : channels) channel.limits.upper = 1.5e5;
  SafetyRules rules = benchRules();
  rules.target_timeout = 5;
  bench.core.adopt(channels, rules);
  EXPECT_EQ(bench.state(), SafetyState::kEnabled);
  EXPECT_EQ(bench.core.orders().set_point, bench.goal);
  bench.silent().run(3.0);
  EXPECT_EQ(bench.state(), SafetyState::kEnabled);
  bench.commands = true;
  bench.goal.setConstant(3e5);
  bench.run(1.0);
  EXPECT_EQ(bench.core.orders().set_point, Eigen::VectorXd::Constant(3, 1.5e5));
}

TEST(SafetyAdopt, LimitsThatTheOrdersAreOutsideOfAreRefusedAndTheOldOnesStay) {
  Bench bench = enabledBench();
  std::vector<ChannelRules> channels = benchChannels();
  channels[1].limits.upper = 0.9e5;
  const std::string refused = test::refusal([&] { bench.core.adopt(channels, benchRules()); });
  EXPECT_NE(refused.find("holds is commanded 100 kPa"), std::string::npos) << refused;
  EXPECT_EQ(bench.core.channels()[1].limits.upper, 4e5);
  // Vented, it is no matter.
  bench.core.vent(bench.now);
  bench.run(5.0);
  ASSERT_EQ(bench.state(), SafetyState::kVented);
  bench.core.adopt(channels, benchRules());
  EXPECT_EQ(bench.core.channels()[1].limits.upper, 0.9e5);
}

TEST(SafetyLoosened, NamesEachRuleThatWouldLetMoreThrough) {
  const std::vector<ChannelRules> channels = benchChannels();
  const auto told =
      [&](const std::function<void(std::vector<ChannelRules>&, SafetyRules&)>& change) {
        std::vector<ChannelRules> next = channels;
        SafetyRules rules = benchRules();
        change(next, rules);
        return loosened(channels, benchRules(), next, rules);
      };
  EXPECT_EQ(told([](auto&, auto&) {}), "");
  EXPECT_EQ(told([](auto& next, auto&) { next[1].limits.upper = 4.5e5; }),
            "the upper limit of holds would go from 400 to 450 kPa");
  EXPECT_EQ(told([](auto& next, auto&) { next[0].limits.lower = -1e4; }),
            "the lower limit of vents would go from 0 to -10 kPa");
  EXPECT_EQ(told([](auto& next, auto&) { next[0].limits.lower = 1e4; }),
            "the lower limit of vents would go from 0 to 10 kPa");
  EXPECT_EQ(told([](auto& next, auto&) { next[2].slew = 2e6; }),
            "safety.slew_kpa_s would go from 1000 to 2000 kPa/s");
  EXPECT_EQ(told([](auto& next, auto&) { next[0].action = FaultAction::kHold; }),
            "safety.fault_action of vents would go from vent to hold");
  EXPECT_EQ(told([](auto&, auto& rules) { rules.target_timeout = 2; }),
            "safety.target_timeout_s would go from 1 to 2 s");
  EXPECT_EQ(told([](auto&, auto& rules) { rules.fall_time_constant = 0.5; }),
            "safety.follow.fall_time_constant_s would go from 0.25 to 0.5 s");
  EXPECT_EQ(told([](auto&, auto& rules) { rules.fall_time_constant = 0.2; }), "");
  EXPECT_EQ(told([](auto&, auto& rules) { rules.min_supply.reset(); }),
            "safety.min_supply_kpa would be lower, or absent");
  for (double SafetyRules::*rule :
       {&SafetyRules::reading_timeout, &SafetyRules::trip_margin, &SafetyRules::spike_time,
        &SafetyRules::follow_tolerance, &SafetyRules::follow_time, &SafetyRules::time_constant,
        &SafetyRules::leak_drop, &SafetyRules::hold_time, &SafetyRules::vented_below,
        &SafetyRules::vent_time}) {
    EXPECT_NE(told([&](auto&, auto& rules) { rules.*rule *= 1.01; }), "");
    EXPECT_EQ(told([&](auto&, auto& rules) { rules.*rule *= 0.99; }), "");
  }
  EXPECT_EQ(told([](auto& next, auto& rules) {
              next[0].limits = {0, 2e5};
              next[1].action = FaultAction::kVent;
              rules.min_supply = 4e5;
            }),
            "");
}

}  // namespace
}  // namespace helix_arm::control
