#include <set>

#include <gtest/gtest.h>

#include "command.hpp"
#include "rod_scene.hpp"
#include "support/temporary_file.hpp"

namespace helix_arm::test {
namespace {

using nlohmann::json;

nlohmann::json forward(const std::string& scene, const std::string& pressure_kpa) {
  return resultOf({"forward", scenePath(scene), "--pressure-kpa", pressure_kpa});
}

Outcome inverse(const std::string& scene, const std::vector<std::string>& target) {
  return runCommand({"inverse", scenePath(scene), "--format", "json"}, target);
}

TEST(Inverse, ReachesTipsPosesAndTwistsThatForwardGave) {
  for (const char* scene : {"spatial_50", "helical_50"}) {
    const nlohmann::json wanted = forward(scene, "100,30,250");
    const std::string tip = commaList(numbersOf(wanted["tip"]["position_m"]));
    const std::string pose = tip + "," + commaList(numbersOf(wanted["tip"]["quaternion_xyzw"]));
    for (const std::vector<std::string>& target : std::vector<std::vector<std::string>>{
             {"--tip", tip},
             {"--pose", pose},
             {"--twist", commaList(numbersOf(wanted["twist"][0]))}}) {
      const Outcome outcome = inverse(scene, target);
      ASSERT_EQ(outcome.exit_code, 0) << target[0] << outcome.out << outcome.err;
      const nlohmann::json result = outcome.json();
      EXPECT_EQ(result["status"], "reached");
      EXPECT_TRUE(result["reason"].is_null());
      EXPECT_EQ(result["converged"], true);
      EXPECT_LE(result["residual"].get<double>(), 1e-6);
      // Three muscles of these arms fix tip and pose: only one answer.
      const std::vector<double> pressure = numbersOf(result["pressure_pa"]);
      EXPECT_NEAR(pressure[0], 100e3, 50);
      EXPECT_NEAR(pressure[1], 30e3, 50);
      EXPECT_NEAR(pressure[2], 250e3, 50);
    }
  }
}

TEST(Inverse, PreferencesPickAmongTheAnswers) {
  // Six actuators for three coordinates leave room for a preference.
  const json tip = forward("annotated", "90,20,40,50,10,30")["tip"]["position_m"];
  std::set<json> answers;
  for (const std::vector<std::string>& options : std::vector<std::vector<std::string>>{
           {},
           {"--prefer", "min-change", "--start-kpa", "90,20,40,50,10,30"},
           {"--prefer", "cocontract"},
           {"--prefer", "cocontract", "--cocontraction", "0.8"}}) {
    const Outcome outcome = runCommand(
        {"inverse", scenePath("annotated"), "--format", "json", "--tip", commaList(numbersOf(tip))},
        options);
    EXPECT_EQ(outcome.exit_code, 0) << outcome.err;
    answers.insert(outcome.json()["pressure_pa"]);
  }
  EXPECT_EQ(answers.size(), 4u);
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

TEST(Inverse, NegativeNumbersAreNoOptions) {
  for (const std::vector<std::string>& target : {std::vector<std::string>{"--tip", "-0.1,0.2,0.3"},
                                                 std::vector<std::string>{"--tip=-0.1,0.2,0.3"}}) {
    const Outcome outcome = inverse("spatial_50", target);
    EXPECT_EQ(outcome.exit_code, 1) << outcome.err;
    EXPECT_EQ(outcome.json()["status"], "unreachable");
  }
}

TEST(Inverse, CsvHasTheSameBitsAsJson) {
  const nlohmann::json result = inverse("helical_50", {"--tip", "0.36,0.01,0"}).json();
  const auto rows = csvRows(
      runCommand({"inverse", scenePath("helical_50"), "--tip", "0.36,0.01,0", "--format", "csv"})
          .out);
  ASSERT_EQ(rows.size(), 2u);
  ASSERT_EQ(rows[0].size(), rows[1].size());
  EXPECT_EQ(rows[0][0], "status");
  EXPECT_EQ(rows[1][0], "reached");
  ASSERT_EQ(rows[0][2], "pressure_1_pa");
  EXPECT_EQ(std::stod(rows[1][2]), result["pressure_pa"][0].get<double>());
}

TEST(Inverse, AQuaternionThatIsRoundedGivesTheAnswerOfTheUnitOne) {
  const auto pressure = [&](const std::string& q) {
    return numbersOf(inverse("spatial_50", {"--pose", "0.4,0,0," + q}).json()["pressure_pa"]);
  };
  const std::vector<double> rounded = pressure("0,0,0,1.0009"), unit = pressure("0,0,0,1");
  for (int i = 0; i < 3; ++i) EXPECT_NEAR(rounded[i], unit[i], 1e-3);
}

TEST(Inverse, TendonsAreAnsweredInRadians) {
  std::string text = kPulledScene;
  text.replace(text.find("planar"), 6, "spatial").replace(text.find("count: 2"), 8, "count: 3");
  const TemporaryFile scene(text);
  const nlohmann::json wanted =
      runCommand({"forward", scene.path(), "--input", "3,1,0.5", "--format", "json"}).json();
  const std::string tip = commaList(numbersOf(wanted["tip"]["position_m"]));
  const Outcome outcome = runCommand({"inverse", scene.path(), "--tip", tip, "--format", "json"});
  ASSERT_EQ(outcome.exit_code, 0) << outcome.err;
  EXPECT_EQ(outcome.json()["input_unit"][0], "rad");
  EXPECT_NEAR(outcome.json()["input"][0].get<double>(), 3, 1e-3);
}

TEST(Inverse, RowsOfATableAreAsSingleCalls) {
  const std::vector<double> a = numbersOf(forward("helical_50", "200,0,50")["tip"]["position_m"]);
  const std::vector<double> b = numbersOf(forward("helical_50", "0,250,20")["tip"]["position_m"]);
  const TemporaryFile table("x_m,y_m,z_m\n" + commaList(a) + "\n" + commaList(b) + "\n9,9,9\n",
                            ".csv");
  const Outcome outcome = inverse("helical_50", {"--targets", table.path()});
  EXPECT_EQ(outcome.exit_code, 1) << "the last is out of reach";
  const nlohmann::json rows = outcome.json()["rows"];
  ASSERT_EQ(rows.size(), 3U);
  EXPECT_EQ(rows[0], inverse("helical_50", {"--tip", commaList(a)}).json());
  EXPECT_EQ(rows[1], inverse("helical_50", {"--tip", commaList(b)}).json());
  EXPECT_EQ(rows[2]["status"], "unreachable");
}

}  // namespace
}  // namespace helix_arm::test
