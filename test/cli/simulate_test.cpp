#include <cmath>
#include <map>
#include <set>

#include <gtest/gtest.h>

#include "command.hpp"
#include "helix_arm/io/scene.hpp"
#include "helix_arm/localization/arm_view.hpp"
#include "rod_scene.hpp"
#include "support/temporary_file.hpp"
#include "support/temporary_folder.hpp"

namespace helix_arm::test {
namespace {

using nlohmann::json;

// Rows of a data set by the names of its columns.
std::vector<std::map<std::string, double>> tableOf(const std::string& path) {
  const auto rows = csvRows(contentOf(path));
  std::vector<std::map<std::string, double>> table;
  for (std::size_t i = 1; i < rows.size(); ++i) {
    table.emplace_back();
    for (std::size_t c = 0; c < rows[0].size(); ++c) {
      table.back()[rows[0][c]] = std::stod(rows[i].at(c));
    }
  }
  return table;
}

Outcome simulate(const std::string& scene, const std::string& out,
                 const std::vector<std::string>& more = {}) {
  return runCommand({"simulate", scene, "--out", out, "--format", "json"}, more);
}

// Tags of a rod.
const char* const kTags = R"(tags:
  size_m: 0.03
  groups:
    - {ids: [4, 9], s: [0.5, 1], position_m: [0, 0, 0.05]}
)";

TEST(Simulate, ASceneWithACameraGivesPicturesPosesAndTruth) {
  const TemporaryFolder folder;
  const Outcome outcome = simulate(scenePath("demo"), folder.path(), {"--count", "3"});
  ASSERT_EQ(outcome.exit_code, 0) << outcome.err;
  EXPECT_EQ(outcome.err, "");
  EXPECT_EQ(namesIn(folder.path()),
            (std::set<std::string>{"scene.yaml", "truth.csv", "tag_poses.csv", "tag_corners.csv",
                                   "picture_0001.jpg", "picture_0002.jpg", "picture_0003.jpg"}));
  const json result = outcome.json();
  EXPECT_EQ(result["captures"], 3);
  EXPECT_EQ(result["pictures"], 3);
  EXPECT_EQ(result["truth"], folder / "truth.csv");
  EXPECT_EQ(result["tag_corners"], folder / "tag_corners.csv");
  EXPECT_EQ(tableOf(folder / "truth.csv").size(), 3u);
  EXPECT_EQ(tableOf(folder / "tag_poses.csv").size(), 3u * result["tags"].get<unsigned>());
  const std::string scene = contentOf(scenePath("demo"));
  EXPECT_EQ(contentOf(folder / "scene.yaml").substr(0, scene.size()), scene);
}

// A camera of another focal length than the file says: the scene that is written knows it.
TEST(Simulate, TheWrittenSceneDescribesThePictures) {
  const TemporaryFolder folder;
  ASSERT_EQ(simulate(scenePath("demo"), folder.path(),
                     {"--count", "2", "--set", "camera.focal_px=[800, 810]", "--set",
                      "simulation.camera.clutter=0"})
                .exit_code,
            0);
  const Outcome outcome =
      runCommand({"localize", folder / "scene.yaml", folder.path(), "--format", "json"});
  ASSERT_EQ(outcome.exit_code, 0) << outcome.out;
  const auto truth = tableOf(folder / "truth.csv");
  for (int i = 0; i < 2; ++i) {
    const json frame = outcome.json()["frames"][i];
    EXPECT_EQ(frame["state"], "measured");
    EXPECT_LT(frame["rms_px"].get<double>(), 0.3);
    EXPECT_EQ(frame["suspicious"], json::array());
    EXPECT_NEAR(frame["twist"][0][0].get<double>(), truth[i].at("section_1_vx_m"), 0.005);
  }
}

// 3 axes of 2 tags in 400 captures: 4 standard errors of their mean and of their deviation.
TEST(Simulate, PositionsHaveTheNoiseOfTheScene) {
  const TemporaryFile scene(kBareRodScene + kTags);
  const TemporaryFolder folder;
  const std::string noisy = folder / "noisy", exact = folder / "exact";
  const auto simulateNoise = [&scene](const std::string& out, const std::string& noise) {
    return simulate(scene.path(), out,
                    {"--count", "400", "--set", "vision.tag_position_noise_m=" + noise});
  };
  ASSERT_EQ(simulateNoise(noisy, "0.01").exit_code, 0);
  ASSERT_EQ(simulateNoise(exact, "1e-6").exit_code, 0);
  const auto a = tableOf(noisy + "/tag_poses.csv"), b = tableOf(exact + "/tag_poses.csv");
  ASSERT_EQ(a.size(), 800u);
  ASSERT_EQ(b.size(), 800u);
  double sum = 0, squares = 0;
  for (std::size_t i = 0; i < a.size(); ++i) {
    for (const char* axis : {"x_m", "y_m", "z_m"}) {
      const double error = a[i].at(axis) - b[i].at(axis);
      sum += error;
      squares += error * error;
    }
  }
  EXPECT_NEAR(sum / 2400, 0, 4 * 0.01 / std::sqrt(2400.0));
  EXPECT_NEAR(std::sqrt(squares / 2400), 0.01, 0.01 * 4 / std::sqrt(2 * 2400.0));
}

TEST(Simulate, TheSeedDecidesEveryFile) {
  const TemporaryFolder folder;
  const std::string first = folder / "first", again = folder / "again", other = folder / "other";
  ASSERT_EQ(simulate(scenePath("demo"), first, {"--count", "2", "--seed", "5"}).exit_code, 0);
  ASSERT_EQ(simulate(scenePath("demo"), again, {"--count", "2", "--seed", "5"}).exit_code, 0);
  ASSERT_EQ(simulate(scenePath("demo"), other, {"--count", "2", "--seed", "6"}).exit_code, 0);
  for (const std::string& name : namesIn(first)) {
    EXPECT_EQ(contentOf(first + "/" + name), contentOf(again + "/" + name)) << name;
    EXPECT_NE(contentOf(first + "/" + name), contentOf(other + "/" + name)) << name;
  }
}

}  // namespace
}  // namespace helix_arm::test
