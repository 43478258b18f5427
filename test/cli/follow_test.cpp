#include <gtest/gtest.h>

#include "command.hpp"
#include "support/temporary_folder.hpp"

namespace helix_arm::test {
namespace {

using nlohmann::json;

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
