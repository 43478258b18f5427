#include <Eigen/Core>

#include <gtest/gtest.h>

#include "command.hpp"
#include "helix_arm/io/scene.hpp"
#include "io/document/number.hpp"
#include "support/temporary_folder.hpp"

namespace helix_arm::test {
namespace {

Outcome workspace(const std::string& scene, const std::vector<std::string>& more) {
  return runCommand({"workspace", scene, "--format", "json"}, more);
}

TEST(Workspace, TheCsvHoldsInputsAndTheTipsThatTheyLeadTo) {
  const TemporaryFolder folder;
  const std::string name = "loaded";
  const std::string path = folder / (name + ".csv");
  const Outcome outcome = workspace(scenePath(name), {"--out", path, "--count", "500"});
  ASSERT_EQ(outcome.exit_code, 0) << outcome.err;
  EXPECT_EQ(contentOf(path).front(), '#');
  const auto rows = csvRows(contentOf(path));
  ASSERT_EQ(rows.size(), 501u);
  const io::Scene scene = io::loadScene(scenePath(name));
  const int n = scene.arm.actuatorCount();
  ASSERT_EQ(rows[0].size(), n + 3u);
  for (int i = 0; i < n; ++i) {
    EXPECT_EQ(rows[0][i], "pressure_" + std::to_string(i + 1) + "_kpa");
  }
  EXPECT_EQ(rows[0][n] + rows[0][n + 1] + rows[0][n + 2], "x_my_mz_m");
  Eigen::Vector3d least = Eigen::Vector3d::Constant(9), most = -least;
  for (std::size_t row = 1; row < rows.size(); ++row) {
    Eigen::VectorXd q(n);
    for (int i = 0; i < n; ++i) q[i] = io::pascals(std::stod(rows[row][i]));
    const Eigen::Vector3d tip(std::stod(rows[row][n]), std::stod(rows[row][n + 1]),
                              std::stod(rows[row][n + 2]));
    EXPECT_LT((scene.model.tip(scene.arm.clamped(q)).tip.translation - tip).norm(), 1e-11);
    least = least.cwiseMin(tip);
    most = most.cwiseMax(tip);
  }
  const nlohmann::json result = outcome.json();
  EXPECT_EQ(result["count"], 500);
  EXPECT_EQ(result["unbalanced"], 0);
  EXPECT_EQ(result["tier"], statics::nameOf(scene.model.choice().setting.tier));
  for (std::size_t i = 0; i < 3; ++i) {
    EXPECT_NEAR(result["sampled_bounds_m"]["min"][i].get<double>(), least[i], 1e-11);
    EXPECT_GE(result["bounds_m"]["max"][i].get<double>(), most[i] - 1e-11);
  }
}

}  // namespace
}  // namespace helix_arm::test
