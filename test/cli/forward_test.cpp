#include <cmath>

#include <gtest/gtest.h>

#include "command.hpp"
#include "rod_scene.hpp"
#include "support/temporary_file.hpp"

namespace helix_arm::test {
namespace {

Outcome forward(const std::string& scene, const std::string& pressure_kpa,
                const std::vector<std::string>& more = {}) {
  return runCommand(
      {"forward", scenePath(scene), "--pressure-kpa", pressure_kpa, "--format", "json"}, more);
}

TEST(Forward, AnArmThatNothingLoadsIsInClosedForm) {
  const nlohmann::json spatial = forward("spatial_50", "0,0,0").json();
  EXPECT_EQ(spatial["tier"], "linear");
  EXPECT_TRUE(spatial["order"].is_null());
  EXPECT_TRUE(has(spatial["tier_reason"], "the arm has no load"));
  EXPECT_EQ(spatial["status"], "converged");
  EXPECT_TRUE(spatial["failure"].is_null());
  EXPECT_EQ(spatial["iterations"], 0);
  EXPECT_EQ(spatial["relative_residual"], 0.0);
  EXPECT_EQ(spatial["tip_error_percent"], 0.0);
  for (const char* key : {"pieces", "piece_twist", "curve"}) EXPECT_FALSE(spatial.contains(key));
  const nlohmann::json helix = spatial["sections"][0]["helix"];
  EXPECT_TRUE(helix["radius_m"].is_null()) << "it is straight";
  EXPECT_EQ(helix["turns"], 0.0);
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

TEST(Forward, CsvAndJsonHoldTheSameBits) {
  const nlohmann::json result = forward("helical_50", "300,20,7").json();
  const std::string csv = runCommand({"forward", scenePath("helical_50"), "--pressure-kpa",
                                      "300,20,7", "--format", "csv"})
                              .out;
  ASSERT_EQ(csvRows(csv).size(), 2u);
  const auto cell = [&csv](const char* name) { return std::stod(csvColumn(csv, name).at(0)); };
  EXPECT_EQ(cell("section_1_wx_rad"), result["twist"][0][3].get<double>());
  EXPECT_EQ(cell("tip_x_m"), result["tip"]["position_m"][0].get<double>());
  EXPECT_EQ(cell("tip_qw"), result["tip"]["quaternion_xyzw"][3].get<double>());
  EXPECT_EQ(cell("length_2_m"), result["lengths_m"][1].get<double>());
  EXPECT_EQ(cell("pressure_3_pa"), 7000.0);
  const auto curve = csvRows(runCommand({"forward", scenePath("helical_50"), "--pressure-kpa",
                                         "300,20,7", "--format", "csv", "--samples", "4"})
                                 .out);
  ASSERT_EQ(curve.size(), 5u);
  EXPECT_EQ(curve[0], (std::vector<std::string>{"s", "x_m", "y_m", "z_m", "qx", "qy", "qz", "qw"}));
  EXPECT_EQ(std::stod(curve[4][1]), result["tip"]["position_m"][0].get<double>());
}

TEST(Forward, TendonsTakeRadians) {
  const TemporaryFile scene(kPulledScene);
  const nlohmann::json result = resultOf({"forward", scene.path(), "--input", "2,0"});
  EXPECT_GT(result["twist"][0][5].get<double>(), 0.1);
  EXPECT_FALSE(result.contains("pressure_pa"));
  EXPECT_EQ(numbersOf(result["input"]), (std::vector<double>{2, 0}));
  EXPECT_EQ(result["input_unit"][0], "rad");
}

TEST(Forward, PressuresMayBeGivenInPascals) {
  const Outcome si = runCommand(
      {"forward", scenePath("planar_76"), "--input", "250000,50000", "--format", "json"});
  EXPECT_EQ(si.out, forward("planar_76", "250,50").out);
}

TEST(Command, HelpAndVersionGoToStdout) {
  const Outcome version = runCommand({"--version"});
  EXPECT_EQ(version.exit_code, 0);
  EXPECT_EQ(version.out.find("helix_arm "), 0u) << version.out;
  for (const char* subcommand : {"forward", "inverse", "evaluate"}) {
    const Outcome help = runCommand({subcommand, "--help"});
    EXPECT_EQ(help.exit_code, 0);
    EXPECT_TRUE(has(help.out, "json:"));
  }
}

TEST(Forward, PressuresThatLookLikeKilopascalsAreWarnedOf) {
  const auto warned = [](const std::string& option, const std::string& value) {
    const auto run = runCommand({"forward", scenePath("helical_50"), option, value});
    EXPECT_EQ(run.exit_code, 0) << run.err;
    return run.err.find("looks like kPa") != std::string::npos;
  };
  const std::string pascals = "pressure_1_pa,pressure_2_pa,pressure_3_pa\n0,0,0\n";
  EXPECT_TRUE(warned("--input", "200,0,50"));
  EXPECT_TRUE(warned("--inputs", TemporaryFile("input_1,input_2,input_3\n0,0,0\n1,2,3\n").path()));
  EXPECT_TRUE(warned("--inputs", TemporaryFile(pascals + "100,200,0\n").path()));
  EXPECT_FALSE(warned("--inputs", TemporaryFile(pascals + "1e5,200,0\n").path()));
  EXPECT_FALSE(warned("--inputs", TemporaryFile("pressure_1_kpa\n0\n1\n").path()));
  EXPECT_FALSE(warned("--input", "200e3,0,50"));
  EXPECT_FALSE(warned("--pressure-kpa", "0.2,0,0"));
}

// What one of forward and inverse prints, the other reads.
TEST(Forward, TakesWhatInversePrintsAndTheOtherWayRound) {
  const TemporaryFile targets("x_m,y_m,z_m\n0.36,0.03,0.02\n0.37,0.005,0.01\n");
  const auto run = [](const char* command, const char* option, const TemporaryFile& table) {
    const Outcome out =
        runCommand({"--format", "csv", command, scenePath("demo"), option, table.path()});
    EXPECT_EQ(out.exit_code, 0) << out.err << out.out;
    return out;
  };
  const Outcome found = run("inverse", "--targets", targets);
  const Outcome tips = run("forward", "--inputs", TemporaryFile(found.out));
  const Outcome back = run("inverse", "--targets", TemporaryFile(tips.out));
  for (int row = 0; row < 2; ++row) {
    for (const char* name : {"tip_x_m", "tip_y_m", "tip_z_m"}) {
      const double wanted = std::stod(csvColumn(found.out, name).at(row));
      EXPECT_NEAR(std::stod(csvColumn(tips.out, name).at(row)), wanted, 1e-12) << name;
      EXPECT_NEAR(std::stod(csvColumn(back.out, name).at(row)), wanted, 1e-6) << name;
    }
  }
}

TEST(Forward, RowsOfATableAreAsSingleCalls) {
  const TemporaryFile table(
      "# made up\npressure_1_kpa,pressure_2_kpa,pressure_3_kpa\n"
      "200,0,50\n0,310.5,0\n",
      ".csv");
  const nlohmann::json rows =
      resultOf({"forward", scenePath("helical_50"), "--inputs", table.path()})["rows"];
  ASSERT_EQ(rows.size(), 2U);
  const char* const inputs[] = {"200,0,50", "0,310.5,0"};
  for (std::size_t k = 0; k < 2; ++k) {
    const nlohmann::json single =
        resultOf({"forward", scenePath("helical_50"), "--pressure-kpa", inputs[k]});
    EXPECT_EQ(rows[k], single) << inputs[k];
  }
  const Outcome csv =
      runCommand({"forward", scenePath("helical_50"), "--inputs", table.path(), "--format", "csv"});
  EXPECT_EQ(csvRows(csv.out).size(), 3U) << csv.out;
}

}  // namespace
}  // namespace helix_arm::test
