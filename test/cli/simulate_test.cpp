#include <map>

#include <gtest/gtest.h>

#include "command.hpp"
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

}  // namespace
}  // namespace helix_arm::test
