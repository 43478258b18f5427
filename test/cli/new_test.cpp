// helix_arm new: the scene that it writes loads, passes the check and holds what was asked for.
#include <filesystem>

#include <gtest/gtest.h>

#include "command.hpp"
#include "helix_arm/io/scene.hpp"
#include "support/temporary_folder.hpp"

namespace helix_arm::test {
namespace {

TEST(New, TheDefaultSceneLoadsAndPassesTheCheck) {
  const TemporaryFolder folder;
  const std::string out = folder / "arm_7.yaml";
  const Outcome outcome = runCommand({"new", "--out", out, "--format", "json"});
  ASSERT_EQ(outcome.exit_code, 0) << outcome.err;
  EXPECT_EQ(outcome.json()["scene"], "arm_7");
  EXPECT_EQ(outcome.json()["actuators"], 3);
  const io::Scene scene = io::loadScene(out);
  EXPECT_EQ(outcome.json()["tags"], scene.tags->tags.size());
  const Outcome check = runCommand({"check", out, "--format", "json"});
  EXPECT_EQ(check.exit_code, 0) << check.out;
  EXPECT_EQ(check.json()["passed"], true);
}

TEST(New, ArmsOfManyKindsHaveNoFaults) {
  const std::vector<std::vector<std::string>> kinds = {
      {"--sections", "2", "--tags", "5", "--tilt-deg", "15"},
      {"--sections", "3", "--tag-size-m", "0.025", "--tags", "5"},
      {"--muscles", "6", "--length-m", "0.6", "--radius-m", "0.05"},
      {"--length-m", "0.15", "--radius-m", "0.012", "--tag-size-m", "0.02"},
      {"--regulator", "generic", "--device", "/dev/ttyUSB7"},
      {"--regulator", "none", "--tag-size-m", "0"},
      {"--max-pressure-kpa", "517.1", "--contraction", "0.3"}};
  const TemporaryFolder folder;
  const std::string out = folder / "arm.yaml";
  for (const std::vector<std::string>& kind : kinds) {
    std::vector<std::string> call{"new", "--out", out, "--force"};
    call.insert(call.end(), kind.begin(), kind.end());
    const Outcome outcome = runCommand(call);
    ASSERT_EQ(outcome.exit_code, 0) << kind[1] << outcome.err;
    const Outcome check = runCommand({"check", out});
    EXPECT_EQ(check.exit_code, 0) << kind[0] << " " << kind[1] << ": " << check.out << check.err;
  }
}

TEST(New, WhatWasAskedForIsInTheScene) {
  const TemporaryFolder folder;
  const std::string out = folder / "arm.yaml";
  ASSERT_EQ(runCommand({"new", "--out", out, "--muscles", "4", "--length-m", "0.4", "--contraction",
                        "0.25", "--max-pressure-kpa", "200", "--tag-size-m", "0.028", "--tags", "3",
                        "--camera-distance-m", "0.9"})
                .exit_code,
            0);
  const io::Scene scene = io::loadScene(out);
  ASSERT_EQ(scene.arm.actuatorCount(), 4);
  EXPECT_EQ(scene.arm.actuator(3).limits.upper, 2e5);
  EXPECT_NEAR(scene.arm.lengths(scene.arm.inputAt(0))[0], 0.4, 1e-9);
  EXPECT_NEAR(scene.arm.lengths(scene.arm.inputAt(1))[0], 0.3, 1e-9);
  EXPECT_EQ(scene.tags->tags.size(), 12u);
  EXPECT_EQ(scene.tags->size, 0.028);
}

TEST(New, WhatDoesNotFitIsRefusedByName) {
  const TemporaryFolder folder;
  const std::string out = folder / "arm.yaml";
  const auto refusal = [&](std::vector<std::string> options, const std::string& words) {
    options.insert(options.begin(), {"new", "--out", out});
    const Outcome outcome = runCommand(options);
    EXPECT_EQ(outcome.exit_code, 2);
    EXPECT_NE(outcome.err.find(words), std::string::npos) << outcome.err;
    EXPECT_FALSE(std::filesystem::exists(out));
  };
  refusal({"--muscles", "2"}, "muscles is 2");
  refusal({"--muscles", "8"}, "overlap; expected at most 27 mm");
  refusal({"--tags", "9"}, "9 tags of 30 mm");
  refusal({"--length-m", "30"}, "length is 30; expected 0.02 to 5 m");
  refusal({"--contraction", "nan"}, "contraction");
  refusal({"--regulator", "festo"}, "regulator is festo");
  refusal({"--device", "/dev/ttyUSB0"}, "--device goes with --regulator generic");
  refusal({"--set", "arm.geometry=planar"}, "leave out --set");
  const Outcome text = runCommand({"new", "--out", folder / "arm.txt"});
  EXPECT_EQ(text.exit_code, 2);
  ASSERT_EQ(runCommand({"new", "--out", out}).exit_code, 0);
  const std::string before = contentOf(out);
  EXPECT_EQ(runCommand({"new", "--out", out, "--muscles", "4"}).exit_code, 2);
  EXPECT_EQ(contentOf(out), before);
}

}  // namespace
}  // namespace helix_arm::test
