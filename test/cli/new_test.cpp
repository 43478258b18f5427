// helix_arm new: the scene that it writes loads, passes the check and holds what was asked for.
#include <cmath>
#include <cstdio>

#include <gtest/gtest.h>

#include "command.hpp"
#include "helix_arm/io/scene.hpp"
#include "support/temporary_folder.hpp"
#include "support/test_size.hpp"

namespace helix_arm::test {
namespace {

class New : public testing::Test {
 protected:
  // Writes the scene of these options.
  Outcome write(const std::vector<std::string>& options,
                const std::vector<std::string>& more = {}) const {
    std::vector<std::string> call{"new", "--out", out_, "--force"};
    call.insert(call.end(), options.begin(), options.end());
    const Outcome outcome = runCommand(call, more);
    EXPECT_EQ(outcome.exit_code, 0) << outcome.err;
    return outcome;
  }
  io::Scene made(const std::vector<std::string>& options,
                 const std::vector<std::string>& more = {}) const {
    write(options, more);
    return io::loadScene(out_);
  }
  void expectSound(const std::vector<std::string>& more = {}) const {
    const Outcome check = runCommand({"check", out_}, more);
    EXPECT_EQ(check.exit_code, 0) << check.out << check.err;
  }

  const TemporaryFolder folder_;
  const std::string out_ = folder_ / "arm_7.yaml";
};

TEST_F(New, ArmsOfManyKindsHaveNoFaults) {
  const std::vector<std::vector<std::string>> kinds = {
      {"--sections", "2", "--tags", "5", "--tilt-deg", "15"},
      {"--sections", "3", "--tag-size-m", "0.025", "--tags", "5"},
      {"--muscles", "6", "--length-m", "0.6", "--radius-m", "0.05"},
      {"--length-m", "0.15", "--radius-m", "0.012", "--tag-size-m", "0.02"},
      {"--sections", "3", "--muscles", "4", "--defaults"},
      {"--regulator", "generic", "--device", "/dev/ttyUSB7"},
      {"--regulator", "none", "--tag-size-m", "0"},
      {"--max-pressure-kpa", "517.1", "--contraction", "0.3"},
      {"--mounting", "standing", "--sections", "2", "--extending"},
      {"--mounting", "lying", "--sections", "6"},
      {"--mounting", "lying", "--chambers", "--muscles", "4"},
      {"--chambers", "--sections", "2", "--length-m", "0.14", "--muscles", "6"}};
  int number = 0;
  for (const std::vector<std::string>& kind : kinds) {
    if (!test::isDrawn(number++, 3)) continue;
    SCOPED_TRACE(kind[0] + " " + kind[1]);
    write(kind);
    expectSound();
  }
}

// The table of faults in docs/board.md holds for the safety rules that stand there.
TEST_F(New, TheSceneOfTheBoardHasTheSafetyRulesThatItWasTestedWith) {
  const std::string document = contentOf(HELIX_ARM_SOURCE_DIR "/docs/board.md");
  const std::size_t begin = document.find("\nsafety:\n") + 1;
  const std::string rules = document.substr(begin, document.find("```", begin) - begin);
  ASSERT_TRUE(has(rules, "target_timeout_s: "));
  write({"--regulator", "generic"});
  const std::string text = contentOf(out_);
  ASSERT_TRUE(has(text, "\nsafety:\n"));
  EXPECT_EQ(text.substr(text.find("\nsafety:\n") + 1), rules);
}

TEST_F(New, AnExtendingArmLengthensAndBendsAwayFromTheMuscleWithPressure) {
  for (const char* const kind : {"--extending", "--chambers"}) {
    SCOPED_TRACE(kind);
    const io::Scene scene =
        made({kind, "--length-m", "0.4", "--contraction", "0.25", "--tag-size-m", "0"});
    EXPECT_NEAR(scene.arm.lengths(scene.arm.inputAt(0))[0], 0.4, 1e-9);
    EXPECT_NEAR(scene.arm.lengths(scene.arm.inputAt(1))[0], 0.5, 1e-9);
    EXPECT_EQ(scene.arm.actuator(0).limits.upper, 1e5) << "rubber takes less than a braid";
    // The first one lies at +y.
    const nlohmann::json bent = resultOf({"forward", out_, "--pressure-kpa", "100,0,0"});
    EXPECT_LT(bent["tip"]["position_m"][1], -0.05);
  }
}

// Two pressures that bend an arm 70 degrees apart: two of four around it, whose others are not in
// the recording.
TEST(NewOfARecording, TakesActuatorsAndTheirHighestPressure) {
  std::string rows = "time_s,pressure_1_kpa,pressure_2_kpa,x_m,y_m,z_m\n";
  for (int k = 0; k < 400; ++k) {
    const double a = k / 200 % 2 == 0 ? 0.5 - 0.5 * std::cos(0.1 * k) : 0,
                 b = 0.5 - 0.5 * std::cos(0.037 * k), y = a + 0.34 * b, z = 0.94 * b;
    char row[120];
    std::snprintf(row, sizeof row, "%g,%g,%g,%g,%g,%g\n", 0.1 * k, 72.3 * a, 72.3 * b,
                  0.3 - 0.01 * (y * y + z * z), 0.04 * y, 0.04 * z);
    rows += row;
  }
  const TemporaryFolder folder;
  const TemporaryFile recording(rows, ".csv");
  const std::string out = folder / "arm.yaml";
  resultOf({"new", "--defaults", "--recording", recording.path(), "--out", out});
  const io::Scene scene = io::loadScene(out);
  EXPECT_EQ(scene.arm.actuatorCount(), 4);
  EXPECT_EQ(scene.arm.actuator(0).limits.upper, 74e3);
  EXPECT_FALSE(scene.tags || scene.regulator);
  const Outcome refused =
      runCommand({"new", "--defaults", "--force", "--recording", scenePath("demo"), "--out", out});
  EXPECT_EQ(refused.exit_code, 2);
}

}  // namespace
}  // namespace helix_arm::test
