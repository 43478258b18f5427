#include "helix_arm/model/response.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <tuple>
#include <utility>
#include <vector>

#include <gtest/gtest.h>

#include "helix_arm/model/arm_response.hpp"
#include "support/allocation_counter.hpp"
#include "support/random.hpp"
#include "support/refusal.hpp"
#include "support/sample_arm.hpp"

namespace helix_arm::model {
namespace {

using test::Random;
using test::refusal;

constexpr double kRest = std::numeric_limits<double>::infinity();
constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();
constexpr Range kLimits{0.0, 5e5};
constexpr double kRounding = 1e-12 * 5e5;  // of a pressure [Pa]

Response playsOf(const std::vector<Response::Play>& plays) {
  Response response;
  response.play_count = static_cast<int>(plays.size());
  std::copy(plays.begin(), plays.end(), response.plays.begin());
  return response;
}

const Response kTwoPlays = playsOf({{2e4, 0.3}, {6e4, 0.4}});

Response randomResponse(Random& random) {
  std::vector<Response::Play> plays(static_cast<std::size_t>(random.integer(1, kMaxPlays)));
  double reach = 0.0, left = 0.95;
  for (Response::Play& play : plays) {
    reach += random.uniform(1e3, 5e4);
    play = {reach, random.uniform(0, left)};
    left -= play.weight;
  }
  return playsOf(plays);
}

void visit(ResponseState& state, const std::vector<double>& inputs) {
  for (const double input : inputs) state.step(input, kRest);
}

ResponseState after(const Response& response, const std::vector<double>& inputs) {
  ResponseState state(response);
  visit(state, inputs);
  return state;
}

std::vector<double> randomInputs(Random& random, int count) {
  std::vector<double> inputs(static_cast<std::size_t>(count));
  for (double& input : inputs) input = random.uniform(kLimits.lower, kLimits.upper);
  return inputs;
}

TEST(Response, PlayDependsOnTheTurningPointsNotOnTheRate) {
  Random random(2);
  for (int trial = 0; trial < 100; ++trial) {
    const Response response = randomResponse(random);
    const std::vector<double> turns = randomInputs(random, 10);
    ResponseState slow(response), fast(response);
    for (const double turn : turns) {
      const double from = slow.started() ? slow.lagged() : turn;
      for (int step = 1; step < 50; ++step) slow.step(from + (turn - from) * step / 50, 1e-3);
      slow.step(turn, 1e-3);
      fast.step(turn, 5);
      EXPECT_NEAR(slow.effective(), fast.effective(), kRounding);
    }
  }
}

TEST(Response, TheInverseClosesOverRandomHistories) {
  Random random(7);
  int inside = 0;
  for (int trial = 0; trial < 400; ++trial) {
    ResponseState state(randomResponse(random));
    for (const double input : randomInputs(random, 10)) {
      state.step(input, kRest);  // the first ones of an unknown past
      const Range range = state.effectiveRange(kLimits);
      const double wanted = random.uniform(range.lower, range.upper);
      const double x = state.inputFor(wanted, kLimits);
      ASSERT_TRUE(kLimits.contains(x));
      EXPECT_NEAR(state.effectiveAt(x), wanted, kRounding);
      ResponseState moved = state;
      moved.step(x, kRest);
      EXPECT_NEAR(moved.effective(), wanted, kRounding);
      EXPECT_NEAR(state.inputFor(state.effective(), kLimits), state.lagged(), 20 * kRounding);
      if (x > kLimits.lower && x < kLimits.upper) ++inside;
      // Out of reach: the limit.
      EXPECT_EQ(state.inputFor(range.upper + 1, kLimits), kLimits.upper);
      EXPECT_EQ(state.inputFor(range.lower - 1, kLimits), kLimits.lower);
      EXPECT_NEAR(state.effectiveAt(state.inputFor(range.upper, kLimits)), range.upper, kRounding);
      EXPECT_NEAR(state.effectiveAt(state.inputFor(range.lower, kLimits)), range.lower, kRounding);
    }
  }
  EXPECT_GT(inside, 3000);
}

TEST(Response, AReadingThatIsNoNumberStepsNothing) {
  Response response = kTwoPlays;
  response.rise_time = 1;
  response.fall_time = 2;
  ResponseState state = after(response, {1e5, 3e5, 2e5});
  const double effective = state.effective(), x = state.lagged();
  for (const double bad : {kNaN, kRest, -kRest}) state.step(bad, 1);
  state.step(5e5, -1);
  state.step(5e5, kNaN);
  EXPECT_EQ(state.effective(), effective);
  EXPECT_EQ(state.lagged(), x);
  ResponseState fresh(response);
  fresh.step(kNaN, 1);
  EXPECT_FALSE(fresh.started());
}

TEST(Response, TheLagIsExactForStepsOfAnySize) {
  Response response;
  response.rise_time = 0.5;
  response.fall_time = 1.25;
  Random random(9);
  for (const auto& [from, to, tau] : {std::tuple{1e5, 3e5, 0.5}, std::tuple{3e5, 1e5, 1.25}}) {
    for (const double time : {1e-9, 1e-3, 0.1, 1.0, 30.0}) {
      const double expected = to + (from - to) * std::exp(-time / tau);
      ResponseState one(response), many(response);
      one.step(from, 0);
      many.step(from, 0);
      one.step(to, time);
      double left = time;
      for (int i = 0; i < 100; ++i) {
        const double dt = random.uniform(0, 0.05) * left;
        many.step(to, dt);
        many.step(to, 0);  // changes nothing
        left -= dt;
      }
      many.step(to, left);
      EXPECT_NEAR(one.effective(), expected, kRounding);
      EXPECT_NEAR(many.effective(), expected, kRounding);
    }
    ResponseState rested(response);
    visit(rested, {from, to});
    EXPECT_EQ(rested.effective(), to);
  }
}

Response slowOf(double lag, double time, double weight, Response response = {}) {
  response.rise_time = response.fall_time = lag;
  response.slow_time = time;
  response.slow_weight = weight;
  return response;
}

// s behind a lag from 1e5 to 3e5, from x = s, by Runge-Kutta steps of its differential equation.
double integratedSlow(double lag, double slow, double time) {
  constexpr int kSteps = 20000;
  const double dt = time / kSteps;
  double s = 1e5;
  for (int i = 0; i < kSteps; ++i) {
    const auto rate = [&](double t, double at) {
      const double left = lag == 0 ? 0.0 : std::exp(-(i * dt + t) / lag);
      return (3e5 - 2e5 * left - at) / slow;
    };
    const double a = rate(0, s), b = rate(dt / 2, s + dt / 2 * a), c = rate(dt / 2, s + dt / 2 * b),
                 d = rate(dt, s + dt * c);
    s += dt / 6 * (a + 2 * b + 2 * c + d);
  }
  return s;
}

TEST(Response, TheSlowStateIsExactForStepsOfAnySize) {
  Random random(10);
  for (const double lag : {0.0, 0.3, 2.0, 2.0 + 1e-12, 2.0 + 1e-6, 2.1, 30.0}) {
    const Response response = slowOf(lag, 2.0, 0.6);
    for (const double time : {1e-9, 0.1, 3.0, 40.0}) {
      ResponseState one(response), many(response);
      one.step(1e5, 0);
      many.step(1e5, 0);
      one.step(3e5, time);
      double left = time;
      for (int i = 0; i < 100; ++i) {
        const double dt = random.uniform(0, 0.05) * left;
        many.step(3e5, dt);
        left -= dt;
      }
      many.step(3e5, left);
      EXPECT_NEAR(many.effective(), one.effective(), 10 * kRounding) << lag << " " << time;
      const double s = integratedSlow(lag, 2.0, time);
      EXPECT_NEAR(one.effective(), 0.4 * one.lagged() + 0.6 * s, 1e-3) << lag << " " << time;
    }
    EXPECT_EQ(after(response, {1e5, 3e5}).effective(), 3e5);  // at rest
  }
}

TEST(Response, TheInverseClosesWithTheSlowStateHeldAndAtRest) {
  Random random(11);
  int inside = 0;
  for (int trial = 0; trial < 200; ++trial) {
    Response response = randomResponse(random);
    for (int j = 0; j < kMaxPlays; ++j) response.plays[j].weight *= 0.5;
    if (trial % 3 == 0) response.play_count = 0;
    response = slowOf(0, 5, random.uniform(0, 0.45), response);
    ResponseState state(response);
    for (const double input : randomInputs(random, 10)) {
      state.step(input, random.uniform(0, 10));
      for (const AfterMove when : {AfterMove::kSlowHeld, AfterMove::kAtRest}) {
        const Range range = state.effectiveRange(kLimits, when);
        const double wanted = random.uniform(range.lower, range.upper);
        const double x = state.inputFor(wanted, kLimits, when);
        ASSERT_TRUE(kLimits.contains(x));
        inside += x > kLimits.lower && x < kLimits.upper;
        ResponseState moved = state;
        moved.step(x, when == AfterMove::kAtRest ? kRest : 0.0);
        EXPECT_NEAR(moved.effective(), wanted, 20 * kRounding);
        EXPECT_EQ(state.inputFor(range.upper + 1, kLimits, when), kLimits.upper);
      }
    }
  }
  EXPECT_GT(inside, 3000);
}

TEST(Response, PlaysFollowTheLaggedInput) {
  Response response = kTwoPlays;
  response.rise_time = response.fall_time = 0.8;
  ResponseState state(response);
  state.step(1e5, 0);
  state.step(4e5, 0.4);
  const double x = 4e5 - 3e5 * std::exp(-0.5);
  EXPECT_NEAR(state.lagged(), x, kRounding);
  EXPECT_NEAR(state.effective(), x - 0.3 * 2e4 - 0.4 * 6e4, kRounding);
  EXPECT_NEAR(after(kTwoPlays, {0, 5e5, 3e5}).effective(), 3e5 + 0.3 * 2e4 + 0.4 * 6e4, kRounding);
}

TEST(Response, RefusesWeightsOfPlaysAndSlowStateBeyond95Percent) {
  const auto check = [](const Response& response) { return refusal([&] { response.validate(); }); };
  const std::string fault = "response: the sum of the weights is 0.96; expected at most 0.95";
  EXPECT_EQ(check(playsOf({{2e4, 0.5}, {4e4, 0.46}})), fault);
  EXPECT_EQ(check(playsOf({{2e4, 0.3}, {4e4, 0.65}})), "accepted");
  EXPECT_EQ(check(slowOf(0, 7, 0.3, playsOf({{2e4, 0.66}}))), fault);
}

Arm armWith(const Response& response) {
  Arm plain = test::sampleArm();
  std::vector<Section> sections(1);
  for (int i = 0; i < plain.actuatorCount(); ++i) {
    sections[0].actuators.push_back(plain.actuator(i));
    sections[0].actuators.back().response = response;
  }
  return Arm(std::move(sections));
}

TEST(ArmResponse, FollowsReadingsAtTheirTimes) {
  Response response = kTwoPlays;
  response.rise_time = response.fall_time = 0.5;
  const Arm arm = armWith(response);
  ArmResponse effective(arm);
  ResponseState expected(response);
  EXPECT_FALSE(effective.instant());
  EXPECT_TRUE(ArmResponse(armWith({})).instant());
  EXPECT_FALSE(effective.follow(100, Eigen::Vector3d(1e5, 1e5, 1e5)));
  EXPECT_FALSE(effective.follow(100.5, Eigen::Vector3d(3e5, kNaN, 3e5)));
  EXPECT_FALSE(effective.follow(100.5, Eigen::Vector3d(3e5, kNaN, 3e5)));  // a paused clock
  expected.step(1e5, 0);
  EXPECT_EQ(effective.effective()[1], expected.effective());
  expected.step(3e5, 0.5);
  EXPECT_EQ(effective.effective()[0], expected.effective());
  // The channel without a reading makes up for its time.
  EXPECT_FALSE(effective.follow(101, Eigen::Vector3d(3e5, 3e5, 3e5)));
  expected.step(3e5, 0.5);
  EXPECT_NEAR(effective.effective()[0], expected.effective(), kRounding);
  EXPECT_NEAR(effective.effective()[1], expected.effective(), kRounding);
}

TEST(ArmResponse, ATimeThatGoesBackRestarts) {
  ArmResponse effective(armWith(kTwoPlays));
  effective.follow(10, Eigen::Vector3d(0, 0, 0));
  effective.follow(11, Eigen::Vector3d(3e5, 3e5, 3e5));
  EXPECT_TRUE(effective.known());
  EXPECT_TRUE(effective.follow(3, Eigen::Vector3d(2e5, 2e5, 2e5)));
  EXPECT_FALSE(effective.known());
  EXPECT_EQ(effective.effective(), Eigen::Vector3d(2e5, 2e5, 2e5));
  EXPECT_EQ(effective.uncertainty(armWith(kTwoPlays)),
            Eigen::Vector3d::Constant(kTwoPlays.halfWidth()));
}

TEST(ArmResponse, DoesNotAllocate) {
  const Response response = slowOf(0.1, 7, 0.2, kTwoPlays);
  const Arm arm = armWith(response);
  ArmResponse effective(arm);
  Eigen::VectorXd reading = Eigen::Vector3d(1e5, 2e5, kNaN), lower(3), upper(3);
  const test::AllocationCounter counter;
  for (int i = 0; i < 100; ++i) {
    reading[0] = 1e3 * i;
    effective.follow(0.01 * (i % 50), reading);  // goes back once
    effective.effectiveLimits(arm, lower, upper);
    effective.inputsFor(arm, lower, reading.head<3>());
    effective.adopt(arm);
  }
  EXPECT_EQ(counter.count(), 0U);
}

}  // namespace
}  // namespace helix_arm::model
