
#include <gtest/gtest.h>

#include "command.hpp"
#include "support/temporary_folder.hpp"

namespace helix_arm::test {
namespace {

using nlohmann::json;

// Two tips in the middle of the demo arm's reach, and a place in the air.
const std::string kTips = "0.36,0.03,0.02;0.36,-0.03,0";

Outcome follow(const std::vector<std::string>& more, const std::string& format = "json") {
  return runCommand({"follow", scenePath("demo"), "--format", format}, more);
}

TEST(Follow, TipsGiveAFigureEach) {
  const Outcome outcome = follow({"--tip", kTips, "--seconds", "6", "--seed", "3"});
  ASSERT_EQ(outcome.exit_code, 0) << outcome.err;
  const json result = outcome.json();
  for (const char* absent : {"rig", "plant", "reason", "path_rms_m", "path_max_m",
                             "last_turn_rms_m", "base_moved", "out"}) {
    EXPECT_EQ(result.at(absent), nullptr) << absent;
  }
  EXPECT_TRUE(result["uncalibrated_tags"].empty()) << "nothing is calibrated";
  EXPECT_EQ(result["contact_blind_s"], 0);
  EXPECT_EQ(result["seed"], 3);
  EXPECT_EQ(result["unreachable"], json({false, false}));
  EXPECT_EQ(result["alarms"], json::array());
  EXPECT_NEAR(result["pictures"].get<int>(), 178, 4);
  // Of the first two tips, in which strokes and lag of the demo's rig are learnt.
  for (const double steady : numbersOf(result["steady_rms_m"])) EXPECT_LT(steady, 1.5e-3);
  for (const double settle : numbersOf(result["settle_s"])) EXPECT_LT(settle, 1.5);
  ASSERT_EQ(result["states"].size(), 2u);
  EXPECT_EQ(result["states"][0]["state"], "open");
  EXPECT_EQ(result["states"][1]["state"], "closed");
  EXPECT_NE(outcome.err.find("closed loop: 3 of 6 s"), std::string::npos) << outcome.err;
  EXPECT_EQ(result["budget"]["parts"].size(), 7u);
  EXPECT_NE(outcome.err.find("standard deviations in mm"), std::string::npos) << outcome.err;
}

// Nobody touches the arm, or somebody does, which is then no proof of anything lighter.
TEST(Follow, AProofOfContactsSetsTheirLimitAndWhatFollows) {
  const TemporaryFolder folder;
  const std::string out = folder / "proven.yaml";
  const auto proof = [&out](const std::vector<std::string>& more) {
    const Outcome outcome = runCommand(
        {"follow", scenePath("demo"), "--format", "json", "--prove-contact", "--out", out}, more);
    EXPECT_EQ(outcome.exit_code, 0) << outcome.err;
    EXPECT_EQ(outcome.json()["out"], out);
    EXPECT_EQ(outcome.json()["alarms"], json::array());
    const json found = outcome.json()["contact_proof"];
    const std::string text = contentOf(out),
                      limit = std::to_string(found["contact_limit"].get<int>());
    EXPECT_TRUE(has(text, "# follow.contact_limit and follow.on_contact"));
    EXPECT_TRUE(has(text, "follow:\n  contact_limit: " + limit +
                              "\n  on_contact: " + found["on_contact"].get<std::string>() + "\n"));
    return found;
  };
  const json quiet = proof({"--seconds", "130"});
  EXPECT_EQ(quiet["on_contact"], "yield");
  EXPECT_EQ(quiet["doubt"], nullptr);
  EXPECT_EQ(quiet["contact_limit"], 32);
  EXPECT_LT(quiet["found_force_n"], 0.5);
  const json touched = proof({"--seconds", "130", "--force", "100,0,0.8,0"});
  EXPECT_GT(touched["highest_score"], 100);
  EXPECT_GE(touched["contact_limit"], 2 * touched["highest_score"].get<double>());
  const json brief = proof({"--seconds", "30"});
  EXPECT_EQ(brief["on_contact"], "report");
  EXPECT_TRUE(has(brief["doubt"], "let it run for longer")) << brief;
  EXPECT_EQ(runCommand({"follow", out, "--prove-contact", "--out", out}).exit_code, 2);
}

}  // namespace
}  // namespace helix_arm::test
