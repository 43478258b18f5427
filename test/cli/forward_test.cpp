#include <cmath>

#include <gtest/gtest.h>

#include "command.hpp"
#include "helix_arm/io/scene.hpp"

namespace helix_arm::test {
namespace {

Outcome forward(const std::string& scene, const std::string& pressure_kpa,
                const std::vector<std::string>& more = {}) {
  return runCommand(
      {"forward", scenePath(scene), "--pressure-kpa", pressure_kpa, "--format", "json"}, more);
}

TEST(Forward, ALostRankComesWithItsNullSpace) {
  // Without bending stiffness nothing holds a planar arm against bending out of its plane.
  const nlohmann::json result =
      forward("planar_76", "100,0", {"--tier", "linear", "--set", "arm.stiffness.K_kappa_m2=0"})
          .json();
  EXPECT_EQ(result["rank"], 5);
  EXPECT_EQ(result["full_rank"], 6);
  ASSERT_EQ(result["sections"][0]["null_space"].size(), 1u);
  const std::vector<double> lost = numbersOf(result["sections"][0]["null_space"][0]);
  EXPECT_NEAR(std::abs(lost[4]), 1, 1e-12);
}

TEST(Forward, GlobalOptionsMayStandAnywhere) {
  const std::string scene = scenePath("planar_76");
  const std::string set = "arm.sections.0.ring.radius_m=0.02";
  const Outcome before =
      runCommand({"--format", "json", "--set", set, "forward", scene, "--pressure-kpa", "200,0"});
  const Outcome after =
      runCommand({"forward", scene, "--pressure-kpa", "200,0", "--set", set, "--format=json"});
  ASSERT_EQ(before.exit_code, 0) << before.err;
  EXPECT_EQ(before.out, after.out);
  EXPECT_NE(before.json()["twist"], forward("planar_76", "200,0").json()["twist"]);
  expectCallerError(runCommand({"forward", scene, "--pressure-kpa", "0,0", "--set", "name"}),
                    "--set name is not key=value");
}

TEST(Forward, PressuresMayBeGivenInPascals) {
  const Outcome si = runCommand(
      {"forward", scenePath("planar_76"), "--input", "250000,50000", "--format", "json"});
  EXPECT_EQ(si.out, forward("planar_76", "250,50").out);
}

Outcome inverse(const std::string& scene, const std::vector<std::string>& target) {
  return runCommand({"inverse", scenePath(scene), "--format", "json"}, target);
}

TEST(Inverse, AnUnreachableTargetGivesTheClosestAndTheReason) {
  // Straight ahead and too far: the vented arm, its free length 0.4269760703 m, is the closest.
  const Outcome outcome = inverse("spatial_50", {"--tip", "0.5,0,0"});
  EXPECT_EQ(outcome.exit_code, 1);
  const nlohmann::json result = outcome.json();
  EXPECT_EQ(result["status"], "unreachable");
  EXPECT_TRUE(has(result["reason"], "no inputs within the limits"));
  EXPECT_NEAR(result["position_error_m"].get<double>(), 0.5 - 0.4269760703, 1e-6);
  EXPECT_NEAR(result["residual"].get<double>(), 0.5 - 0.4269760703, 1e-6);
  ASSERT_EQ(result["active_limits"].size(), 3u);
  EXPECT_EQ(result["active_limits"][0]["actuator"], "muscle_1");
  EXPECT_EQ(result["active_limits"][0]["limit"], "lower");
  for (const double p : numbersOf(result["pressure_pa"])) EXPECT_NEAR(p, 0, 1);
}

// ---- forward under load -------------------------------------------------------------------------

Eigen::Vector3d positionOf(const nlohmann::json& pose) {
  const std::vector<double> p = numbersOf(pose["position_m"]);
  return {p[0], p[1], p[2]};
}

TEST(ForwardLoaded, EveryTierIsThatOfTheLibrary) {
  const io::Scene scene = io::loadScene(scenePath("loaded"));
  const Eigen::Vector3d q(200e3, 0, 50e3);
  const struct {
    std::vector<std::string> options;
    std::optional<statics::Tier> tier;
    std::optional<int> order;
  } cases[] = {{{}, {}, {}},
               {{"--tier", "linear"}, statics::Tier::kLinear, {}},
               {{"--tier", "loaded", "--order", "2"}, statics::Tier::kLoaded, 2},
               {{"--tier", "exact"}, statics::Tier::kExact, {}}};
  for (const auto& asked : cases) {
    const Outcome outcome = forward("loaded", "200,0,50", asked.options);
    ASSERT_EQ(outcome.exit_code, 0) << outcome.err;
    const nlohmann::json result = outcome.json();
    const statics::ArmModel model =
        scene.model.withTier({asked.tier, asked.order, std::nullopt, std::nullopt});
    const statics::Solution expected = model.solve(q);
    SCOPED_TRACE(model.choice().setting.name());
    EXPECT_EQ(result["tier"], statics::nameOf(model.choice().setting.tier));
    EXPECT_EQ(result["tier_reason"], model.choice().reason);
    EXPECT_NEAR(result["tip_error_percent"].get<double>(), 100 * model.choice().relative_tip_error,
                1e-12);
    EXPECT_EQ(result["status"], "converged");
    EXPECT_LT((positionOf(result["tip"]) - expected.tip.translation).norm(), 1e-14);
    const model::Twists twists = expected.shape.twists();
    for (int i = 0; i < 6; ++i) {
      EXPECT_NEAR(result["twist"][0][i].get<double>(), twists(i, 0), 1e-14);
    }
  }
}

TEST(ForwardLoaded, FailedConvergenceIsReportedAndExitsWithOne) {
  const std::vector<std::string> heavy{
      "--tier", "loaded",          "--order", "2",
      "--set",  "load.mass_kg=20", "--set",   "arm.base.rpy_deg=[0, -90, 0]"};
  const Outcome outcome = forward("loaded", "413,0,0", heavy);
  EXPECT_EQ(outcome.exit_code, 1);
  EXPECT_EQ(outcome.err, "");
  const nlohmann::json result = outcome.json();
  EXPECT_EQ(result["status"], "not_converged");
  EXPECT_NE(result["failure"].get<std::string>().find("less load"), std::string::npos);
  EXPECT_GT(result["relative_residual"].get<double>(), 1e-6);
  EXPECT_TRUE(result["tip_error_percent"].is_null());
}

}  // namespace
}  // namespace helix_arm::test
