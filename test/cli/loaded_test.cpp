#include <Eigen/Geometry>

#include <gtest/gtest.h>

#include "command.hpp"
#include "helix_arm/io/scene.hpp"

namespace helix_arm::test {
namespace {

const char* const kHorizontal = "arm.base.rpy_deg=[0, 0, 0]";

Outcome forward(const std::string& scene, const std::vector<std::string>& more,
                const std::string& pressure_kpa = "200,0,50") {
  return runCommand(
      {"forward", scenePath(scene), "--pressure-kpa", pressure_kpa, "--format", "json"}, more);
}

Eigen::Vector3d positionOf(const nlohmann::json& pose) {
  const std::vector<double> p = numbersOf(pose["position_m"]);
  return {p[0], p[1], p[2]};
}

struct Asked {
  std::vector<std::string> options;
  std::optional<statics::Tier> tier;
  std::optional<int> order;
};

TEST(ForwardLoaded, EveryTierIsThatOfTheLibrary) {
  const io::Scene scene = io::loadScene(scenePath("loaded"));
  const Eigen::Vector3d q(200e3, 0, 50e3);
  const Asked cases[] = {{{}, {}, {}},
                         {{"--tier", "auto"}, {}, {}},
                         {{"--tier", "linear"}, statics::Tier::kLinear, {}},
                         {{"--tier", "loaded", "--order", "2"}, statics::Tier::kLoaded, 2},
                         {{"--tier", "loaded", "--order", "8"}, statics::Tier::kLoaded, 8},
                         {{"--tier", "exact"}, statics::Tier::kExact, {}}};
  for (const Asked& asked : cases) {
    const Outcome outcome = forward("loaded", asked.options);
    ASSERT_EQ(outcome.exit_code, 0) << outcome.err;
    const nlohmann::json result = outcome.json();
    const statics::ArmModel model =
        scene.model.withTier({asked.tier, asked.order, std::nullopt, std::nullopt});
    const statics::Solution expected = model.solve(q);
    SCOPED_TRACE(model.choice().setting.name());
    EXPECT_EQ(result["tier"], statics::nameOf(model.choice().setting.tier));
    if (model.choice().setting.order > 0) {
      EXPECT_EQ(result["order"], model.choice().setting.order);
    } else {
      EXPECT_TRUE(result["order"].is_null());
    }
    EXPECT_EQ(result["tier_reason"], model.choice().reason);
    EXPECT_NEAR(result["tip_error_percent"].get<double>(), 100 * model.choice().relative_tip_error,
                1e-12);
    EXPECT_EQ(result["status"], "converged");
    EXPECT_EQ(result["iterations"], expected.iterations);
    EXPECT_LT((positionOf(result["tip"]) - expected.tip.translation).norm(), 1e-14);
    const model::Twists twists = expected.shape.twists();
    for (int i = 0; i < 6; ++i) {
      EXPECT_NEAR(result["twist"][0][i].get<double>(), twists(i, 0), 1e-14);
    }
    const bool whole = model.choice().setting.tier == statics::Tier::kLinear;
    EXPECT_EQ(result.value("pieces", 0), whole ? 0 : expected.shape.piecesPerSection());
    if (whole) continue;
    EXPECT_NEAR(result["piece_twist"].back()[0].get<double>(),
                expected.shape.pieces().rightCols<1>()(0), 1e-14);
  }
}

TEST(ForwardLoaded, AccuracyAndBudgetChoose) {
  const auto chosen = [](std::vector<std::string> options) {
    options.insert(options.end(), {"--set", kHorizontal});
    const Outcome outcome = forward("loaded", options);
    EXPECT_EQ(outcome.exit_code, 0) << outcome.err;
    return outcome.json();
  };
  const nlohmann::json rough = chosen({"--accuracy", "5"}), fine = chosen({"--accuracy", "1e-4"});
  EXPECT_LE(rough["tip_error_percent"].get<double>(), 5);
  EXPECT_LE(fine["tip_error_percent"].get<double>(), 1e-4);
  EXPECT_GT(rough["tip_error_percent"].get<double>(), 1e-4);
  // A second is enough for any tier.
  const nlohmann::json slow = chosen({"--budget", "1e6"});
  EXPECT_LE(slow["tip_error_percent"].get<double>(), fine["tip_error_percent"].get<double>());
  // What the command asks for takes the place of all that the scene does.
  EXPECT_EQ(chosen({"--set", "tier=exact", "--accuracy", "5"})["tier"], rough["tier"]);
  EXPECT_EQ(chosen({"--set", "tier=exact"})["tier"], "exact");
  EXPECT_EQ(chosen({"--set", "accuracy.tip_error_percent=5", "--tier", "exact"})["tier"], "exact");
}

TEST(ForwardLoaded, FailedConvergenceIsReportedAndExitsWithOne) {
  const std::vector<std::string> heavy{
      "--tier", "loaded",          "--order", "2",
      "--set",  "load.mass_kg=20", "--set",   "arm.base.rpy_deg=[0, -90, 0]"};
  const Outcome outcome = forward("loaded", heavy, "413,0,0");
  EXPECT_EQ(outcome.exit_code, 1);
  EXPECT_EQ(outcome.err, "");
  const nlohmann::json result = outcome.json();
  EXPECT_EQ(result["status"], "not_converged");
  EXPECT_NE(result["failure"].get<std::string>().find("less load"), std::string::npos);
  EXPECT_GT(result["relative_residual"].get<double>(), 1e-6);
  EXPECT_TRUE(result["tip_error_percent"].is_null());
  const Outcome csv = runCommand(
      {"forward", scenePath("loaded"), "--pressure-kpa", "413,0,0", "--format", "csv"}, heavy);
  EXPECT_EQ(csvRows(csv.out).at(1)[2], "not_converged");
}

}  // namespace
}  // namespace helix_arm::test
