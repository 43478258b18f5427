#include <filesystem>
#include <fstream>
#include <iterator>
#include <set>
#include <sstream>

#include <gtest/gtest.h>

#include "command.hpp"
#include "support/temporary_folder.hpp"

namespace helix_arm::test {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;

// Two tips in the middle of the demo arm's reach, and a place in the air.
const std::string kTips = "0.36,0.03,0.02;0.36,-0.03,0";
const std::string kCentre = "0.366,0.003,0.009";

Outcome follow(const std::vector<std::string>& more, const std::string& format = "json") {
  return runCommand({"follow", scenePath("demo"), "--format", format}, more);
}

// A circle of the period as a path file.
std::string circle(const TemporaryFolder& folder, const std::string& period,
                   const std::string& radius = "0.02") {
  const std::string path = folder / ("circle_" + radius + "_" + period + ".csv");
  EXPECT_EQ(runCommand({"path", "circle", "--centre", kCentre, "--radius", radius, "--period",
                        period, "--out", path})
                .exit_code,
            0);
  return path;
}

std::set<std::string> keysOf(const json& object) {
  std::set<std::string> keys;
  for (const auto& [key, value] : object.items()) keys.insert(key);
  return keys;
}

TEST(Follow, TipsGiveAFigureEach) {
  const Outcome outcome = follow({"--tip", kTips, "--seconds", "6", "--seed", "3"});
  ASSERT_EQ(outcome.exit_code, 0) << outcome.err;
  const json result = outcome.json();
  std::istringstream words(
      "scene rig plant seed sight open seconds pictures reason path_rms_m path_max_m "
      "last_turn_rms_m steady_rms_m settle_s unreachable states alarms suspects budget out png "
      "base_moved contact_blind_s uncalibrated_tags lag_s lag_deviation_s play_kpa "
      "play_deviation_kpa");
  using Words = std::istream_iterator<std::string>;
  const std::set<std::string> keys{Words(words), Words()};
  EXPECT_EQ(keysOf(result), keys);
  EXPECT_TRUE(result["uncalibrated_tags"].empty()) << "nothing is calibrated";
  EXPECT_EQ(result["base_moved"], nullptr);
  EXPECT_EQ(result["contact_blind_s"], 0);
  EXPECT_EQ(result["scene"], "demo");
  EXPECT_EQ(result["rig"], nullptr);
  EXPECT_EQ(result["seed"], 3);
  EXPECT_EQ(result["sight"], "corners");
  EXPECT_EQ(result["open"], false);
  EXPECT_EQ(result["path_rms_m"], nullptr);
  EXPECT_EQ(result["path_max_m"], nullptr);
  EXPECT_EQ(result["last_turn_rms_m"], nullptr);
  EXPECT_EQ(result["plant"], nullptr);
  EXPECT_EQ(result["reason"], nullptr);
  EXPECT_EQ(result["unreachable"], json({false, false}));
  EXPECT_EQ(result["alarms"], json::array());
  EXPECT_NEAR(result["pictures"].get<int>(), 178, 4);
  // Of the first two tips, in which strokes and lag of the demo's rig are learnt.
  for (const double steady : numbersOf(result["steady_rms_m"])) EXPECT_LT(steady, 1e-3);
  for (const double settle : numbersOf(result["settle_s"])) EXPECT_LT(settle, 1.5);
  ASSERT_EQ(result["states"].size(), 2u);
  EXPECT_EQ(keysOf(result["states"][1]), (std::set<std::string>{"time_s", "state"}));
  EXPECT_EQ(result["states"][0]["state"], "open");
  EXPECT_EQ(result["states"][1]["state"], "closed");
  EXPECT_NE(outcome.err.find("closed loop: 3 of 6 s"), std::string::npos) << outcome.err;
  EXPECT_EQ(result["budget"]["parts"].size(), 7u);
  EXPECT_NE(outcome.err.find("standard deviations in mm"), std::string::npos) << outcome.err;
}

// A scene that knows its rig, and one that does not.
TEST(Follow, TheRigMayBeThatOfAnotherScene) {
  const TemporaryFolder folder;
  const std::string rig = folder / "rig.yaml";
  std::ofstream(rig) << "name: rig";
  EXPECT_EQ(follow({"--tip", kTips, "--seconds", "6", "--rig", rig}).exit_code, 2);
  const auto steady = [](const std::vector<std::string>& more) {
    const Outcome outcome = runCommand({"follow", scenePath("demo"), "--format", "json", "--tip",
                                        kTips, "--seconds", "6", "--open"},
                                       more);
    EXPECT_EQ(outcome.exit_code, 0) << outcome.err;
    return numbersOf(outcome.json()["steady_rms_m"]);
  };
  const std::string exact = "simulation.arm={}";
  const auto itself = steady({"--set", exact}), usual = steady({}),
             foreign = steady({"--set", exact, "--rig", scenePath("demo")});
  for (std::size_t i = 0; i < usual.size(); ++i) {
    EXPECT_LT(itself[i], 0.002);
    EXPECT_EQ(foreign[i], usual[i]);
  }
  const Outcome unlike =
      follow({"--tip", kTips, "--seconds", "6", "--rig", scenePath("spatial_101")});
  EXPECT_EQ(unlike.exit_code, 2);
  EXPECT_NE(unlike.err.find("spatial_101"), std::string::npos) << unlike.err;
}

// examples/plant.py knows nothing of the scene, and swings.
TEST(Follow, APlantStandsInForTheTrueArm) {
  const std::string plant = fs::path(scenePath("demo")).parent_path() / "../../examples/plant.py";
  const Outcome open =
      follow({"--plant", plant, "--tip", "0.38,0.03,0.02", "--seconds", "8", "--open"});
  const Outcome closed = follow({"--plant", plant, "--tip", "0.38,0.03,0.02", "--seconds", "8"});
  ASSERT_EQ(closed.exit_code, 0) << closed.err;
  EXPECT_EQ(closed.json()["plant"], plant);
  EXPECT_GT(open.json()["steady_rms_m"][0], 3e-3);
  EXPECT_LT(closed.json()["steady_rms_m"][0], 1.5e-3);
  const Outcome dead = follow({"--plant", "exit 3", "--tip", "0.38,0.03,0.02", "--seconds", "8"});
  EXPECT_EQ(dead.exit_code, 1);
  EXPECT_TRUE(has(dead.err, "plant \"exit 3\" ended with exit code 3")) << dead.err;
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

TEST(Follow, TheLastTurnOfAClosedPathHasItsOwnFigure) {
  const TemporaryFolder folder;
  const json one = follow({"--path", circle(folder, "4"), "--seconds", "6"}).json();
  EXPECT_EQ(one["last_turn_rms_m"], one["path_rms_m"]);
  // Without a time, the run ends with the path.
  const json whole = follow({"--path", circle(folder, "4")}).json();
  EXPECT_EQ(whole["path_rms_m"], one["path_rms_m"]);
  EXPECT_LT(whole["seconds"], 6);
  const std::string twice = folder / "twice.csv";
  ASSERT_EQ(runCommand({"path", "circle", "--centre", kCentre, "--radius", "0.02", "--period", "4",
                        "--turns", "2", "--out", twice})
                .exit_code,
            0);
  const json two = follow({"--path", twice, "--seconds", "10"}).json();
  EXPECT_LT(two["last_turn_rms_m"], two["path_rms_m"]) << "the first turn is unlearned";
}

TEST(Follow, EachTurnIsARow) {
  const TemporaryFolder folder;
  const Outcome outcome = follow({"--tip", kTips, "--seconds", "4", "--blind", "1,2", "--latency-s",
                                  "0.1", "--out", folder / "turns.csv"},
                                 "csv");
  ASSERT_EQ(outcome.exit_code, 0) << outcome.err;
  EXPECT_EQ(contentOf(folder / "turns.csv"), outcome.out);
  const auto rows = csvRows(outcome.out);
  const std::vector<std::string> names{"time_s",        "wanted_x_m",      "wanted_y_m",
                                       "wanted_z_m",    "true_x_m",        "true_y_m",
                                       "true_z_m",      "measured_time_s", "measured_x_m",
                                       "measured_y_m",  "measured_z_m",    "predicted_x_m",
                                       "predicted_y_m", "predicted_z_m",   "pressure_1_pa",
                                       "pressure_2_pa", "pressure_3_pa",   "state"};
  ASSERT_EQ(rows.at(0), names);
  ASSERT_EQ(rows.size(), 401u);
  for (std::size_t i = 1; i < rows.size(); ++i) {
    ASSERT_EQ(rows[i].size(), names.size());
    EXPECT_EQ(rows[i][7].empty(), rows[i][8].empty());
    if (rows[i][7].empty()) continue;
    EXPECT_NEAR(std::stod(rows[i][0]) - std::stod(rows[i][7]), 0.1, 1e-9);
  }
  EXPECT_EQ(rows[1].back(), "open");
  EXPECT_EQ(rows[190].back(), "coasting");
}

TEST(Follow, APathThatDoesNotBeginHasNoFigures) {
  const TemporaryFolder folder;
  const Outcome outcome = follow({"--path", circle(folder, "8"), "--seconds", "0.3"});
  EXPECT_EQ(outcome.exit_code, 1);
  EXPECT_EQ(outcome.json()["path_rms_m"], nullptr);
  EXPECT_NE(outcome.json()["reason"].get<std::string>().find("raise --seconds"), std::string::npos);
}

// A loop that never closed has not followed anything.
TEST(Follow, AnArmThatIsNeverSeenIsNamedWithTheCause) {
  const auto why = [](const std::vector<std::string>& more) {
    const Outcome outcome = runCommand(
        {"follow", scenePath("demo"), "--format", "json", "--tip", kTips, "--seconds", "2"}, more);
    EXPECT_EQ(outcome.exit_code, outcome.json()["reason"].is_null() ? 0 : 1) << outcome.err;
    return outcome.json()["reason"].is_null() ? "" : outcome.json()["reason"].get<std::string>();
  };
  EXPECT_TRUE(
      has(why({"--blind", "0,2"}), "never seen, so the loop did not close: the picture is lost"));
  EXPECT_TRUE(
      has(why({"--set", "camera.rpy_deg=[0,0,0]"}), "0 tags of the arm are in the picture"));
  EXPECT_TRUE(has(why({"--set", "camera.rpy_deg=[0,0,0]", "--sight", "rendered"}), "(no_tags)"));
  EXPECT_EQ(why({"--blind", "0,2", "--open"}), "");
}

TEST(Follow, ThePictureShowsTheRun) {
  const TemporaryFolder folder;
  const Outcome outcome = follow({"--path", circle(folder, "4"), "--seconds", "6", "--png",
                                  folder / "run.png", "--blind", "2,3"});
  ASSERT_EQ(outcome.exit_code, 0) << outcome.err;
  EXPECT_EQ(outcome.json()["png"], folder / "run.png");
  EXPECT_EQ(contentOf(folder / "run.png").substr(1, 3), "PNG");
  EXPECT_NE(outcome.err.find("open loop, for the picture: 6 of 6 s"), std::string::npos);
}

// A camera that is centimetres from its place in the scene.
TEST(Follow, ACameraThatHasMovedIsNamed) {
  const Outcome outcome =
      follow({"--tip", kTips, "--seconds", "2", "--set",
              "simulation.mounts.camera_translation_m=0.02", "--set", "simulation.mounts.seed=3"});
  ASSERT_EQ(outcome.exit_code, 0) << outcome.err;
  const json moved = outcome.json()["base_moved"];
  ASSERT_TRUE(moved.is_object());
  EXPECT_LT(moved["time_s"], 2);
  EXPECT_GT(moved["translation_m"], 0.01);
  EXPECT_GT(moved["deviations"], 5);
  EXPECT_EQ(outcome.json()["suspects"][0]["cause"], "camera_moved");
  EXPECT_TRUE(has(outcome.err, "the camera or the arm's base is")) << outcome.err;
}

}  // namespace
}  // namespace helix_arm::test
