// helix_arm new: the scene that it writes loads, passes the check and holds what was asked for.
#include <filesystem>
#include <fstream>
#include <variant>

#include <gtest/gtest.h>

#include "command.hpp"
#include "helix_arm/io/regulator_profile.hpp"
#include "helix_arm/io/scene.hpp"
#include "helix_arm/regulator/config.hpp"
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
      {"--sections", "3", "--muscles", "4", "--defaults"},
      {"--regulator", "generic", "--device", "/dev/ttyUSB7"},
      {"--regulator", "none", "--tag-size-m", "0"},
      {"--max-pressure-kpa", "517.1", "--contraction", "0.3"}};
  const TemporaryFolder folder;
  const std::string out = folder / "arm.yaml";
  for (const std::vector<std::string>& kind : kinds) {
    const Outcome outcome = runCommand({"new", "--out", out, "--force"}, kind);
    ASSERT_EQ(outcome.exit_code, 0) << kind[1] << outcome.err;
    const Outcome check = runCommand({"check", out});
    EXPECT_EQ(check.exit_code, 0) << kind[0] << " " << kind[1] << ": " << check.out << check.err;
  }
}

// docs/cli.md says so.
TEST(New, ArmsOfOneToSixSectionsHaveNoFaults) {
  const TemporaryFolder folder;
  const std::string out = folder / "arm.yaml";
  for (const char* const sections : {"1", "2", "3", "4", "5", "6"}) {
    for (const char* const muscles : {"3", "4", "6", "8", "24"}) {
      SCOPED_TRACE(std::string(sections) + " sections of " + muscles);
      const Outcome outcome = runCommand({"new", "--out", out, "--force", "--defaults",
                                          "--sections", sections, "--muscles", muscles});
      ASSERT_EQ(outcome.exit_code, 0) << outcome.err;
      const int actuators = std::stoi(sections) * std::stoi(muscles);
      EXPECT_EQ(io::loadScene(out).tags.has_value(), 2 * actuators <= 64);
      EXPECT_EQ(outcome.err.find("no tags fit") != std::string::npos, 2 * actuators > 64)
          << outcome.err;
      const Outcome check = runCommand({"check", out, "--samples", "60"});
      EXPECT_EQ(check.exit_code, 0) << check.out << check.err;
    }
  }
}

TEST(New, TagsOfALongArmAreLargeEnoughForItsCamera) {
  const TemporaryFolder folder;
  const std::string out = folder / "arm.yaml";
  const auto size = [&out](const std::vector<std::string>& options) {
    EXPECT_EQ(runCommand({"new", "--out", out, "--force", "--defaults"}, options).exit_code, 0);
    return io::loadScene(out).tags->size;
  };
  EXPECT_EQ(size({}), 0.03);
  EXPECT_EQ(size({"--muscles", "8"}), 0.027) << "no more fit side by side";
  EXPECT_EQ(size({"--tags", "9"}), 0.023) << "no more fit in a row";
  // 2.2 px of 930 px/m for each of 8 bits, from 1.75 lengths.
  EXPECT_EQ(size({"--sections", "6"}), 0.06);
  EXPECT_EQ(size({"--sections", "6", "--tag-size-m", "0.02"}), 0.02) << "as was asked for";
  size({"--sections", "3", "--muscles", "4"});
  EXPECT_EQ(io::loadScene(out).tags->tags.size(), 60u) << "five of 64 / 12 per muscle";
}

TEST(New, TheProfileSaysWhatTheDeviceTakes) {
  const TemporaryFolder folder;
  const std::string out = folder / "arm.yaml";
  for (const std::vector<std::string>& options :
       std::vector<std::vector<std::string>>{{"generic", "--sections", "2", "--muscles", "4"},
                                             {"alicat", "--sections", "8", "--tag-size-m", "0"}}) {
    EXPECT_EQ(runCommand({"new", "--out", out, "--force", "--defaults", "--regulator"}, options)
                  .exit_code,
              0);
  }
  EXPECT_NE(regulator::describeChannels(*io::loadScene(out).regulator).find("V, W, X"),
            std::string::npos);
  // A copy of the profile that says what another board has.
  std::string profile = contentOf(HELIX_ARM_SOURCE_DIR "/config/regulators/generic.yaml");
  profile.replace(profile.find("highest_kpa: 300"), 16, "highest_kpa: 200");
  profile.replace(profile.find("  channels: 8 "), 14, "  channels: 9 ");
  const std::string mine = folder / "mine.yaml";
  std::ofstream(mine) << profile;
  ASSERT_EQ(runCommand({"new", "--out", out, "--force", "--defaults", "--regulator", mine,
                        "--sections", "3"})
                .exit_code,
            0);
  EXPECT_EQ(io::loadScene(out).arm.actuator(0).limits.upper, 2e5) << "the default is lowered";
  EXPECT_EQ(runCommand({"check", out}).exit_code, 0);
}

TEST(New, TextsThatYamlReadsOtherwiseAreQuoted) {
  const TemporaryFolder folder;
  const std::string out = folder / "arm.yaml";
  const auto regulatorOf = [&out](const std::vector<std::string>& options) {
    const Outcome outcome =
        runCommand({"new", "--out", out, "--force", "--defaults", "--regulator"}, options);
    EXPECT_EQ(outcome.exit_code, 0) << outcome.err;
    return *io::loadScene(out).regulator;
  };
  for (const char* const text :
       {"/dev/a #b", "/dev/ttyUSB0", "a: b", "- x", "[::1]", "{x}",        "'",
        "\"q\" \\",  "null",         "~",    "12",  "true",  "*a",         "&a",
        "!a",        "%a",           "@a",   "# a", "| a",   "caf\xc3\xa9"}) {
    SCOPED_TRACE(text);
    const regulator::Config serial = regulatorOf({"generic", "--device", text});
    EXPECT_EQ(std::get<regulator::SerialConfig>(serial).device, text);
    const regulator::Config modbus = regulatorOf({"festo_vtem", "--host", text});
    EXPECT_EQ(std::get<regulator::ModbusConfig>(modbus).host, text);
  }
  EXPECT_NE(contentOf(out).find("    host: caf\xc3\xa9\n"), std::string::npos)
      << "plain where YAML reads it so";
  for (const char* const name : {"a \"b\".yaml", "a\\b.yaml", "a #b.yaml", "it's.yaml"}) {
    SCOPED_TRACE(name);
    const std::string copy = folder / name;
    std::filesystem::copy_file(HELIX_ARM_SOURCE_DIR "/config/regulators/generic.yaml", copy);
    const regulator::Config serial = regulatorOf({copy});
    EXPECT_EQ(std::get<regulator::SerialConfig>(serial).profile.name,
              std::filesystem::path(name).stem().string());
  }
}

TEST(New, EveryShippedProfileAndTheFileOfOneMayBeTheRegulator) {
  const TemporaryFolder folder;
  const std::string out = folder / "arm.yaml";
  const std::vector<std::string> profiles = io::shippedProfiles();
  ASSERT_GE(profiles.size(), 5u);
  for (const std::string& profile : profiles) {
    SCOPED_TRACE(profile);
    const Outcome outcome =
        runCommand({"new", "--out", out, "--force", "--regulator", profile, "--format", "json"});
    ASSERT_EQ(outcome.exit_code, 0) << outcome.err;
    EXPECT_EQ(outcome.json()["regulator"], profile);
    EXPECT_NE(regulator::describe(*io::loadScene(out).regulator).find(" " + profile + " at "),
              std::string::npos);
  }
  ASSERT_EQ(runCommand({"new", "--out", out, "--force", "--regulator", "alicat", "--device",
                        "/dev/ttyUSB7"})
                .exit_code,
            0);
  EXPECT_EQ(regulator::describe(*io::loadScene(out).regulator),
            "ascii_serial alicat at /dev/ttyUSB7");
  EXPECT_EQ(regulator::describeChannels(*io::loadScene(out).regulator), "addresses A, B, C");
  ASSERT_EQ(runCommand(
                {"new", "--out", out, "--force", "--regulator", "festo_vtem", "--host", "10.1.2.3"})
                .exit_code,
            0);
  EXPECT_EQ(regulator::describe(*io::loadScene(out).regulator),
            "modbus_tcp festo_vtem at 10.1.2.3:502");
  // Relative to the working folder, which is not that of the scene.
  const std::string copy = folder / "my_board.yaml";
  std::filesystem::copy_file(HELIX_ARM_SOURCE_DIR "/config/regulators/generic.yaml", copy);
  ASSERT_EQ(runCommand({"new", "--out", out, "--force", "--regulator",
                        std::filesystem::relative(copy).string()})
                .exit_code,
            0);
  EXPECT_NE(regulator::describe(*io::loadScene(out).regulator).find(" my_board at "),
            std::string::npos);
}

// The table of faults in docs/board.md holds for the safety rules that stand there.
TEST(New, TheSceneOfTheBoardHasTheSafetyRulesThatItWasTestedWith) {
  const std::string document = contentOf(HELIX_ARM_SOURCE_DIR "/docs/board.md");
  const std::size_t begin = document.find("\nsafety:\n") + 1;
  const std::string rules = document.substr(begin, document.find("```", begin) - begin);
  ASSERT_NE(rules.find("target_timeout_s: "), std::string::npos);
  const TemporaryFolder folder;
  const std::string out = folder / "arm.yaml";
  ASSERT_EQ(runCommand({"new", "--out", out, "--regulator", "generic"}).exit_code, 0);
  const std::string text = contentOf(out);
  ASSERT_NE(text.find("\nsafety:\n"), std::string::npos);
  EXPECT_EQ(text.substr(text.find("\nsafety:\n") + 1), rules);
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

}  // namespace
}  // namespace helix_arm::test
