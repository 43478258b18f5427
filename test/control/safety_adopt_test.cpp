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

}  // namespace
}  // namespace helix_arm::control
