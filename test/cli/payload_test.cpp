// helix_arm payload and attain; calibrate and evaluate of a testing machine.
#include <filesystem>

#include <gtest/gtest.h>

#include "command.hpp"
#include "support/temporary_file.hpp"
#include "support/temporary_folder.hpp"

namespace helix_arm::test {
namespace {

using nlohmann::json;

// What the place carries is a force under which the inverse still reaches it, and beyond it not.
TEST(PayloadCommand, InverseUnderTheForceReachesThePlace) {
  const std::string tip = "0.37,0,0.02";
  const json found = resultOf({"payload", "loaded", "--tip", tip, "--direction", "0,2,0"});
  EXPECT_EQ(found["status"], "reached");
  ASSERT_EQ(found["directions"].size(), 1u);
  const json& one = found["directions"][0];
  EXPECT_EQ(one["direction"], json({0.0, 1.0, 0.0}));
  EXPECT_EQ(found["weakest"], one);
  EXPECT_GT(one["stiffness_n_per_m"], 0);
  EXPECT_FALSE(one["limit"].get<std::string>().empty());
  for (const double part : {0.95, 1.05}) {
    const double force = part * one["force_n"].get<double>();
    const json inverse =
        runCommand({"inverse", "loaded", "--tip", tip, "--format", "json", "--set",
                    "load.tip={mass_kg: 0.05, force_n: [0, " + std::to_string(force) + ", 0]}"})
            .json();
    EXPECT_EQ(inverse["position_error_m"] < found["tolerance_m"], part < 1) << part;
  }
}

TEST(PayloadCommand, MapHasARowForEachPlaceAndAPicture) {
  const TemporaryFolder folder;
  const std::string png = folder / "map.png";
  const json found = resultOf({"payload", "loaded", "--map", "--count", "60", "--png", png});
  EXPECT_EQ(found["count"], 60);
  EXPECT_LE(found["weakest"]["force_n"], found["median_n"]);
  EXPECT_EQ(found["png"], png);
  EXPECT_GT(std::filesystem::file_size(png), 10000u);
  const Outcome csv =
      runCommand({"payload", "loaded", "--map", "--count", "60", "--format", "csv"});
  EXPECT_EQ(csvColumn(csv.out, "force_n").size(), 60u);
  EXPECT_EQ(std::stod(csvColumn(csv.out, "x_m")[0]) > 0, true);
}

// The pieces of a shape under load are attainable under that load, and not under a far larger one.
TEST(AttainCommand, ShapeUnderLoadIsHeldByItsPressures) {
  const json forward = resultOf(
      {"forward", "loaded", "--pressure-kpa", "100,50,200", "--order", "5", "--tier", "loaded"});
  std::vector<double> twists;
  for (const json& piece : forward["piece_twist"]) {
    for (const json& number : piece) twists.push_back(number);
  }
  const std::string shape = "--twists=" + commaList(twists);
  const json held = resultOf({"attain", "loaded", shape});
  EXPECT_TRUE(held["attainable"]);
  for (std::size_t i = 0; i < 3; ++i) {
    EXPECT_NEAR(held["pressures_pa"][i], forward["pressure_pa"][i], 1e3);
  }
  const json missed = resultOf({"attain", "loaded", shape, "--force", "1,500,0,0"}, 1);
  EXPECT_FALSE(missed["attainable"]);
  EXPECT_TRUE(has(missed["limit"].get<std::string>(), "upper"));
  EXPECT_GT(missed["missing"]["force_n"][0], 1);
  EXPECT_GT(missed["residual_n"], 0.01 * missed["largest_force_n"].get<double>());
}

// A scene of four muscles that lengthen, and readings of two on a machine.
std::string bellowsScene() {
  return "name: bellows\ncontractions:\n  bellows: {table: {pressure_kpa: [0, 80], length_m: "
         "[0.06, 0.1]}}\narm:\n  geometry: spatial\n  stiffness: {K_gamma: 10, K_tau_m2: 1.0e-4, "
         "K_kappa_m2: 1.0e-4}\n  sections: [{name: arm, ring: {count: 4, radius_m: 0.03, "
         "contraction: bellows}}]\n";
}
std::string standReadings() {
  std::string out = "pressure_kpa,length_m,force_n\n";
  for (const double length : {0.05, 0.07, 0.09}) {
    for (int i = 0; i <= 40; ++i) {
      const double p = 2.0 * i, free = 0.06 + 1e-3 * p, K = 10 + 0.2 * p;
      out += std::to_string(p) + "," + std::to_string(length) + "," +
             std::to_string(2 * K * (length - free) / 0.06) + "\n";
    }
  }
  return out;
}

TEST(StandCommand, CalibratedSceneHasTheLawOfTheMachine) {
  const TemporaryFolder folder;
  const TemporaryFile scene(bellowsScene(), ".yaml"), data(standReadings(), ".csv");
  const std::string out = folder / "out.yaml";
  const json found = resultOf({"calibrate", scene.path(), data.path(), "--fit", "contraction,K_eps",
                               "--muscles", "2", "--out", out});
  EXPECT_TRUE(found["success"]);
  EXPECT_LT(found["rms_n"], 0.05);
  EXPECT_LT(found["held_out"]["rms_n"], 0.2);
  EXPECT_EQ(found["rows"], 123);
  for (const json& one : found["curve"]) {
    const double p = one["pressure_pa"].get<double>() / 1e3;
    EXPECT_NEAR(one["length_m"], 0.06 + 1e-3 * p, 1e-4);
    EXPECT_NEAR(one["K_eps_n"], 10 + 0.2 * p, 0.1);
  }
  const json again = resultOf({"evaluate", out, data.path(), "--muscles", "2"});
  EXPECT_NEAR(again["rms_n"], found["rms_n"], 1e-3);
  EXPECT_EQ(again["rows_beyond_curve"], 0);
  // The calibrated arm carries: it knows K_eps now.
  EXPECT_EQ(runCommand({"payload", out, "--tip", "0.07,0,0"}).exit_code, 0);
  EXPECT_EQ(runCommand({"payload", scene.path(), "--tip", "0.07,0,0"}).exit_code, 2);
}

}  // namespace
}  // namespace helix_arm::test
