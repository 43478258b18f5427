// Histories of pressures: effective pressures of actuators with a response.

#include <cmath>

#include <gtest/gtest.h>

#include "command.hpp"
#include "support/temporary_file.hpp"

namespace helix_arm::test {
namespace {

const std::vector<std::string> kPlays{
    "--set", "contractions.planar_muscle.response={play_kpa: [10, 40], play_weight: [0.25, 0.5]}"};
constexpr double kHalfWidth = 0.25 * 10e3 + 0.5 * 40e3;  // [Pa]

Outcome run(const std::string& command, std::vector<std::string> options,
            const std::vector<std::string>& response = kPlays) {
  options.insert(options.begin(), {command, scenePath("planar_76"), "--format", "json"});
  return runCommand(options, response);
}

// The second muscle stays at 50 kPa: its memory is not known.
const TemporaryFile kUpAndDown("pressure_1_kpa,pressure_2_kpa\n0,50\n100,50\n300,50\n200,50\n");

TEST(Response, AHistoryGivesTheShapeAtEffectivePressures) {
  const Outcome outcome = run("forward", {"--history", kUpAndDown.path()});
  ASSERT_EQ(outcome.exit_code, 0) << outcome.err;
  const nlohmann::json result = outcome.json();
  // On the way down: behind by half the loop.
  EXPECT_NEAR(result["effective_pressure_pa"][0].get<double>(), 200e3 + kHalfWidth, 1e-6);
  EXPECT_NEAR(result["effective_pressure_pa"][1].get<double>(), 50e3, 1e-6);
  EXPECT_EQ(result["pressure_pa"], (std::vector<double>{200e3, 50e3}));
  EXPECT_EQ(result["response"]["history_rows"], 4);
  EXPECT_EQ(result["response"]["memory_known"], false);
  EXPECT_EQ(numbersOf(result["response"]["half_width_pa"]),
            (std::vector<double>{kHalfWidth, kHalfWidth}));
  EXPECT_EQ(numbersOf(result["response"]["uncertainty_pa"]), (std::vector<double>{0, kHalfWidth}));
  EXPECT_TRUE(result["response"]["note"].is_null());
  const nlohmann::json still = run("forward", {"--pressure-kpa", "222.5,50"}, {}).json();
  EXPECT_EQ(result["tip"], still["tip"]);
  ASSERT_EQ(result["history"].size(), 4U);
  EXPECT_EQ(result["history"][2]["pressure_pa"][0], 300e3);
  EXPECT_NEAR(result["history"][2]["effective_pressure_pa"][0].get<double>(), 300e3 - kHalfWidth,
              1e-6);
  EXPECT_TRUE(result["history"][2]["time_s"].is_null());
  EXPECT_EQ(result["history"][3]["tip"], result["tip"]);
}

TEST(Response, TimesMakeASeriesAndTrialsStartAnew) {
  const TemporaryFile series(
      "trial,time_s,pressure_1_kpa\nrun A,10,0\nrun A,10.5,100\nrun A,11.5,100\nB,3,80\n");
  const nlohmann::json result =
      run("forward", {"--history", series.path()},
          {"--set", "contractions.planar_muscle.response={rise_time_constant_s: 0.5}"})
          .json();
  const auto effective = [&](int row) {
    return result["history"][row]["effective_pressure_pa"][0].get<double>();
  };
  EXPECT_EQ(result["history"][1]["time_s"], 10.5);
  EXPECT_NEAR(effective(1), 100e3 * (1 - std::exp(-1.0)), 1e-6);
  EXPECT_NEAR(effective(2), 100e3 * (1 - std::exp(-3.0)), 1e-6);
  EXPECT_EQ(effective(3), 80e3);
}

TEST(Response, WithoutAHistoryEffectivePressuresAreThePressuresAndTheResultSaysSo) {
  const std::vector<std::string> call{"--pressure-kpa", "200,50"};
  const nlohmann::json plain = run("forward", call, {}).json();
  nlohmann::json result = run("forward", call).json();
  EXPECT_EQ(result["response"]["history_rows"], 0);
  EXPECT_EQ(result["response"]["memory_known"], false);
  EXPECT_EQ(result["response"]["note"],
            "at rest, with every effective pressure the pressure itself: the middle of hysteresis "
            "loops of up to "
            "+-22.5 kPa");
  EXPECT_FALSE(plain.contains("response"));
  result.erase("response");
  EXPECT_EQ(result, plain);  // all else as without one
  const nlohmann::json workspace = run("workspace", {"--count", "10"}).json();
  EXPECT_EQ(workspace["response"]["note"], run("forward", call).json()["response"]["note"]);
}

TEST(Response, ASlowStateIsFollowedAndToldWhenItRests) {
  const std::vector<std::string> slow{
      "--set", "contractions.planar_muscle.response={slow_time_constant_s: 2, slow_weight: 0.6}"};
  const TemporaryFile series("time_s,pressure_1_kpa,pressure_2_kpa\n0,0,0\n1,200,0\n");
  const nlohmann::json result = run("forward", {"--history", series.path()}, slow).json();
  EXPECT_NEAR(result["effective_pressure_pa"][0].get<double>(),
              200e3 * (0.4 + 0.6 * (1 - std::exp(-0.5))), 1e-6);
  EXPECT_EQ(result["response"]["rest_time_s"], 10);
  EXPECT_EQ(result["response"]["memory_known"], false);
  EXPECT_NEAR(numbersOf(result["response"]["uncertainty_pa"])[0], 0.6 * 413685.6 * std::exp(-0.5),
              1e3);
  EXPECT_EQ(run("forward", {"--pressure-kpa", "200,50"}, slow).json()["response"]["note"],
            "at rest, which takes 10 s, with every effective pressure the pressure itself");
}

TEST(Response, UnattainableEffectivePressuresAreOutOfReach) {
  // Straight at rest is out of reach on the way down from 300 kPa, where half the loop remains.
  const TemporaryFile high("pressure_1_kpa,pressure_2_kpa\n0,0\n400,0\n300,0\n");
  const nlohmann::json rest = run("forward", {"--pressure-kpa", "0,0"}, {}).json();
  const std::string tip = commaList(numbersOf(rest["tip"]["position_m"]));
  EXPECT_EQ(run("inverse", {"--tip", tip}).exit_code, 0);
  const Outcome outcome = run("inverse", {"--tip", tip, "--history", high.path()});
  EXPECT_EQ(outcome.exit_code, 1);
  const nlohmann::json result = outcome.json();
  EXPECT_EQ(result["status"], "unreachable");
  EXPECT_EQ(result["pressure_pa"][0], 0);
  EXPECT_NEAR(result["effective_pressure_pa"][0].get<double>(), kHalfWidth, 1e-6);
  EXPECT_EQ(result["active_limits"][0]["limit"], "lower");
}

}  // namespace
}  // namespace helix_arm::test
