#include <Eigen/Geometry>
#include <cmath>

#include <gtest/gtest.h>

#include "command.hpp"
#include "helix_arm/io/scene.hpp"
#include "helix_arm/model/curve.hpp"
#include "helix_arm/statics/exact.hpp"

namespace helix_arm::test {
namespace {

const char* const kHorizontal = "arm.base.rpy_deg=[0, 0, 0]";

Outcome forward(const std::string& scene, std::vector<std::string> more,
                const std::string& pressure_kpa = "200,0,50") {
  more.insert(more.begin(),
              {"forward", scenePath(scene), "--pressure-kpa", pressure_kpa, "--format", "json"});
  return runCommand(more);
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
    const int pieces = expected.shape.piecesPerSection();
    if (model.choice().setting.tier == statics::Tier::kLinear) {
      EXPECT_FALSE(result.contains("pieces"));
      continue;
    }
    EXPECT_EQ(result["pieces"], pieces);
    ASSERT_EQ(result["piece_twist"].size(), static_cast<std::size_t>(pieces));
    for (int piece = 0; piece < pieces; ++piece) {
      for (int i = 0; i < 6; ++i) {
        EXPECT_NEAR(result["piece_twist"][piece][i].get<double>(),
                    expected.shape.pieces()(i, piece), 1e-14);
      }
    }
  }
}

TEST(ForwardLoaded, AHangingArmIsLongerByItsWeight) {
  // The strain of three muscles by half the arm's weight and all of the tip's, along a helix that
  // hardly leaves its axis: within a tenth.
  const double expected = 0.427 * (0.2 / 2 + 0.05) * 9.81 / (3 * 900);
  const double longer = positionOf(forward("loaded", {}, "0,0,0").json()["tip"]).x() -
                        positionOf(forward("demo", {}, "0,0,0").json()["tip"]).x();
  EXPECT_NEAR(longer, expected, 0.1 * expected);
  const double heavier =
      positionOf(forward("loaded", {"--set", "load.mass_kg=0.4"}, "0,0,0").json()["tip"]).x() -
      positionOf(forward("demo", {}, "0,0,0").json()["tip"]).x();
  EXPECT_GT(heavier, 1.2 * longer);
}

TEST(ForwardLoaded, AHorizontalArmSags) {
  const Eigen::Vector3d sagging =
      positionOf(forward("loaded", {"--set", kHorizontal}, "0,0,0").json()["tip"]);
  const Eigen::Vector3d straight = positionOf(forward("demo", {}, "0,0,0").json()["tip"]);
  EXPECT_LT(sagging.z(), straight.z() - 0.005);
  const Eigen::Vector3d upside = positionOf(
      forward("loaded", {"--set", "arm.base.rpy_deg=[180, 0, 0]"}, "0,0,0").json()["tip"]);
  EXPECT_GT(upside.z(), straight.z() + 0.005) << "seen from a base that is upside down";
}

TEST(ForwardLoaded, TheCurveEndsAtTheTipOfItsTier) {
  const nlohmann::json result =
      forward("loaded", {"--tier", "exact", "--samples", "9", "--set", kHorizontal}).json();
  ASSERT_EQ(result["curve"].size(), 9u);
  EXPECT_LT(positionOf(result["curve"][0]).norm(), 1e-15);
  EXPECT_LT((positionOf(result["curve"][8]) - positionOf(result["tip"])).norm(), 1e-9);
  // No single helix goes through them: half way the mean twist is off.
  lie::Vector6 mean;
  for (int i = 0; i < 6; ++i) mean[i] = result["twist"][0][i].get<double>();
  const lie::SE3 half = lie::SE3::exp(0.5 * mean);
  EXPECT_GT((positionOf(result["curve"][4]) - half.translation).norm(), 1e-3);
}

// Between the ends of the pieces, too.
TEST(ForwardLoaded, TheCurveIsTheTiersOwnAtEverySample) {
  const nlohmann::json result =
      forward("loaded", {"--tier", "exact", "--samples", "101", "--set", kHorizontal}).json();
  const io::Scene scene = io::loadScene(scenePath("loaded"), {{"arm.base.rpy_deg", "[0, 0, 0]"}});
  statics::ExactOptions fine;
  fine.pieces_per_section = 100;
  const model::Shape shape = statics::ExactArm(scene.arm, *scene.model.load(), fine)
                                 .solve(scene.arm.twists(Eigen::Vector3d(200e3, 0, 50e3)))
                                 .shape;
  ASSERT_EQ(result["curve"].size(), 101u);
  for (int i = 0; i <= 100; ++i) {
    const Eigen::Vector3d expected = model::poseAt(shape, i / 100.0).translation;
    EXPECT_LT((positionOf(result["curve"][i]) - expected).norm(), 1e-10) << i;
  }
}

// Six muscles, three of them inflated: corners that repeat after three muscles bend nothing.
TEST(ForwardLoaded, AnAccuracyIsKeptByARingOfSix) {
  const std::vector<std::string> ring{"--set", "arm.sections.0.ring.count=6",
                                      "--set", "load.mass_kg=0.3",
                                      "--set", "arm.stiffness.K_eps_n=900"};
  std::vector<std::string> asked = ring, exact = ring;
  asked.insert(asked.end(), {"--accuracy", "3.4e-5"});
  exact.insert(exact.end(), {"--tier", "exact"});
  const std::string bent = "413.6,413.6,413.6,0,0,0";
  const Outcome chosen = forward("spatial_50", asked, bent);
  ASSERT_EQ(chosen.exit_code, 0) << chosen.err;
  const Eigen::Vector3d off = positionOf(chosen.json()["tip"]) -
                              positionOf(forward("spatial_50", exact, bent).json()["tip"]);
  EXPECT_LE(100 * off.norm() / 0.4269760703, 3.4e-5) << chosen.json()["tier_reason"];
}

TEST(ForwardLoaded, AccuracyAndBudgetChoose) {
  const std::vector<std::string> horizontal{"--set", kHorizontal};
  const auto chosen = [&](std::vector<std::string> options) {
    options.insert(options.end(), horizontal.begin(), horizontal.end());
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
  std::vector<std::string> csv = heavy;
  csv.insert(csv.begin(),
             {"forward", scenePath("loaded"), "--pressure-kpa", "413,0,0", "--format", "csv"});
  const auto rows = csvRows(runCommand(csv).out);
  ASSERT_EQ(rows.size(), 2u);
  EXPECT_EQ(rows[1][2], "not_converged");
}

TEST(ForwardLoaded, WhatCannotBeHadNamesTheFlag) {
  expectCallerError(forward("loaded", {"--tier", "planar"}),
                    "--tier planar needs a scene with arm.geometry: planar");
  expectCallerError(forward("loaded", {"--order", "3"}), "--order needs --tier loaded");
  expectCallerError(forward("loaded", {"--tier", "exact", "--order", "3"}),
                    "--order needs --tier loaded");
  expectCallerError(forward("loaded", {"--tier", "loaded", "--order", "9"}), "--order");
  expectCallerError(forward("loaded", {"--accuracy", "1", "--budget", "10"}),
                    "give either --accuracy or --budget");
  expectCallerError(forward("loaded", {"--accuracy", "1", "--tier", "linear"}),
                    "--accuracy needs tiers to choose from");
  expectCallerError(forward("loaded", {"--budget", "9", "--tier", "loaded", "--order", "3"}),
                    "--budget needs tiers to choose from");
  for (const char* const percent : {"0", "-1", "200", "inf", "nan", "much"}) {
    expectCallerError(forward("loaded", {"--accuracy", percent}),
                      "--accuracy: " + std::string(percent) + " is not a number from 2e-07 to 100");
  }
  for (const char* const us : {"0", "inf", "1e10"}) {
    expectCallerError(forward("loaded", {"--budget", us}),
                      "--budget: " + std::string(us) + " is not a number from 0.001 to 1e+09");
  }
  expectCallerError(
      forward("loaded", {"--tier", "loaded", "--accuracy", "2e-7", "--set", "load.mass_kg=2",
                         "--set", "arm.stiffness.K_eps_n=60", "--set", "arm.base.rpy_deg=[0,0,0]"}),
      "--accuracy is not possible with scene loaded: accuracy.tip_error_percent: no requested tier "
      "meets");
  expectCallerError(forward("loaded", {"--budget", "1e-3"}),
                    "--budget is not possible with scene loaded: budget.time_us: the cheapest");
  expectCallerError(forward("helical_50", {"--set", "load.mass_kg=0.2"}),
                    "arm.stiffness.K_eps_n is missing; expected a finite value > 0 [N]");
}

}  // namespace
}  // namespace helix_arm::test
