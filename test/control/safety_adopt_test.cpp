#include <gtest/gtest.h>

#include "support/refusal.hpp"
#include "support/safety_bench.hpp"

namespace helix_arm::control {
namespace {

using test::Bench;
using test::benchChannels;
using test::benchRules;

// Enabled, its set points at 100 kPa.
Bench regulating() {
  Bench bench;
  bench.turn();
  EXPECT_EQ(bench.core.enable(bench.now), "");
  bench.run(1.0);
  EXPECT_EQ(bench.core.orders().set_point, bench.goal);
  return bench;
}

TEST(SafetyAdopt, OrdersGoOnUnderNewRules) {
  Bench bench = regulating();
  std::vector<ChannelRules> channels = benchChannels();
  for (ChannelRules& channel : channels) channel.limits.upper = 1.5e5;
  SafetyRules rules = benchRules();
  rules.target_timeout = 5;
  bench.core.adopt(channels, rules);
  EXPECT_EQ(bench.state(), SafetyState::kEnabled);
  EXPECT_EQ(bench.core.orders().set_point, bench.goal);
  bench.commands = false;
  bench.run(3.0);
  EXPECT_EQ(bench.state(), SafetyState::kEnabled);
  bench.commands = true;
  bench.goal.setConstant(3e5);
  bench.run(1.0);
  EXPECT_EQ(bench.core.orders().set_point, Eigen::VectorXd::Constant(3, 1.5e5));
}

TEST(SafetyAdopt, LimitsThatTheOrdersAreOutsideOfAreRefusedAndTheOldOnesStay) {
  Bench bench = regulating();
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

TEST(SafetyAdopt, OtherChannelsAndBrokenRulesAreRefused) {
  Bench bench;
  std::vector<ChannelRules> renamed = benchChannels(), fewer = benchChannels();
  renamed[2].name = "other";
  fewer.pop_back();
  SafetyRules broken = benchRules();
  broken.vent_time = -1;
  EXPECT_NE(test::refusal([&] { bench.core.adopt(renamed, benchRules()); }).find("other"),
            std::string::npos);
  EXPECT_NE(test::refusal([&] { bench.core.adopt(fewer, benchRules()); }).find("2 channels"),
            std::string::npos);
  EXPECT_NE(test::refusal([&] { bench.core.adopt(benchChannels(), broken); }).find("vent_time"),
            std::string::npos);
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
