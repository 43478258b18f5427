#include <cmath>
#include <limits>

#include <gtest/gtest.h>

#include "support/allocation_counter.hpp"
#include "support/random.hpp"
#include "support/refusal.hpp"
#include "support/safety_bench.hpp"

namespace helix_arm::control {
namespace {

using test::Bench;
using test::enabledBench;
using test::kTurn;
using State = SafetyState;
using Cause = SafetyCause;

constexpr double kInfinity = std::numeric_limits<double>::infinity();

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

TEST(SafetyCoreAsAWhole, NothingAllocatesDuringAFault) {
  Bench bench = enabledBench();
  const Eigen::VectorXd none = Eigen::VectorXd::Constant(3, std::nan(""));
  const Eigen::VectorXd high = Eigen::VectorXd::Constant(3, 5e5);
  const test::AllocationCounter counter;
  for (int k = 0; k < 200; ++k) {
    bench.now += kTurn;
    bench.core.linked(bench.now, true);
    bench.core.target(bench.now, k % 3 == 0 ? none : bench.goal);
    bench.core.measured(bench.now, k < 100 ? bench.pressure : high, 5e5);
    bench.core.advance(bench.now);
  }
  bench.core.linked(bench.now, false);
  bench.core.emergencyStop(bench.now, true);
  bench.core.vent(bench.now);
  bench.core.advance(bench.now);
  EXPECT_EQ(counter.count(), 0u);
  EXPECT_EQ(bench.cause(), Cause::kOverLimit);
}

TEST(SafetyCoreAsAWhole, FaultsOfRulesAndChannelsAreReported) {
  const auto refused = [](void (*spoil)(SafetyRules&)) {
    SafetyRules rules;
    spoil(rules);
    return test::refusal([&] { SafetyCore(test::benchChannels(), rules); });
  };
  constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
  EXPECT_EQ(refused([](SafetyRules&) {}), "accepted");
  EXPECT_EQ(refused([](SafetyRules& r) { r.target_timeout = kInfinity; }), "accepted");
  EXPECT_EQ(refused([](SafetyRules& r) { r.spike_time = r.trip_margin = r.hold_time = 0; }),
            "accepted");
  EXPECT_EQ(refused([](SafetyRules& r) { r.target_timeout = 0; }),
            "safety rules: target_timeout [s] is 0; expected a value > 0");
  for (double SafetyRules::*positive :
       {&SafetyRules::reading_timeout, &SafetyRules::follow_tolerance, &SafetyRules::follow_time,
        &SafetyRules::time_constant, &SafetyRules::leak_drop, &SafetyRules::vented_below,
        &SafetyRules::vent_time}) {
    for (const double value : {0.0, -1.0, kNan, kInfinity}) {
      SafetyRules rules;
      rules.*positive = value;
      EXPECT_THROW(rules.validate(), std::invalid_argument) << value;
    }
  }
  for (double SafetyRules::*not_negative :
       {&SafetyRules::trip_margin, &SafetyRules::spike_time, &SafetyRules::hold_time}) {
    for (const double value : {-1e-9, kNan, kInfinity}) {
      SafetyRules rules;
      rules.*not_negative = value;
      EXPECT_THROW(rules.validate(), std::invalid_argument) << value;
    }
  }
  EXPECT_EQ(refused([](SafetyRules& r) { r.min_supply = -5; }),
            "safety rules: min_supply [Pa] is -5; expected a finite value > 0");

  const auto channel = [](const ChannelRules& rules) {
    return test::refusal([&] { SafetyCore({rules}, SafetyRules()); });
  };
  EXPECT_EQ(test::refusal([] { SafetyCore({}, SafetyRules()); }),
            "safety core: no channels; expected at least one");
  EXPECT_EQ(channel({"", {0, 1}}), "safety core: a channel has no name; expected one");
  EXPECT_EQ(channel({"m", {1, 0}}),
            "m: the limits [Pa] are 1 to 0; expected finite values, the lower first");
  EXPECT_EQ(channel({"m", {0, 4e5}, 0}), "m: slew [Pa/s] is 0; expected a value > 0");
  EXPECT_THROW(SafetyCore({{"m", {0, 4e5}, kNan}}, SafetyRules()), std::invalid_argument);
  EXPECT_THROW(SafetyCore({{"m", {0, kInfinity}}}, SafetyRules()), std::invalid_argument);
  SafetyRules tight;
  tight.trip_margin = 1e3;
  EXPECT_EQ(
      test::refusal([&] {
        SafetyCore({{"m", {-5e4, 0}}}, tight);
      }),
      "m: vented_below [Pa] is 15000; expected less than 1000, where it is over its limits by "
      "trip_margin");
}

}  // namespace
}  // namespace helix_arm::control
