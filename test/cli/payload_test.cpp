// helix_arm payload and attain; calibrate and evaluate of a testing machine.

#include <gtest/gtest.h>

#include "command.hpp"

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

}  // namespace
}  // namespace helix_arm::test
