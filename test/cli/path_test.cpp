#include <Eigen/Core>

#include <gtest/gtest.h>

#include "command.hpp"

namespace helix_arm::test {
namespace {

// A shape of radius 0.02 m around (0.35, 0.01, -0.02) m, 8 s a turn.
Outcome path(const std::string& shape, const std::vector<std::string>& more = {}) {
  return runCommand(
      {"path", shape, "--centre", "0.35,0.01,-0.02", "--radius", "0.02", "--period", "8"}, more);
}

// The rows of a path file below its header.
std::vector<Eigen::Vector4d> pointsOf(const std::string& text) {
  const auto rows = csvRows(text);
  EXPECT_EQ(rows.at(0), (std::vector<std::string>{"time_s", "x_m", "y_m", "z_m"}));
  std::vector<Eigen::Vector4d> points(rows.size() - 1);
  for (std::size_t i = 0; i < points.size(); ++i) {
    for (int k = 0; k < 4; ++k) points[i][k] = std::stod(rows[i + 1].at(k));
  }
  return points;
}

TEST(Path, ACircleIsPrintedAsAPathFile) {
  for (const char* format : {"text", "csv"}) {
    const Outcome outcome = path("circle", {"--format", format});
    ASSERT_EQ(outcome.exit_code, 0) << outcome.err;
    EXPECT_EQ(outcome.err, "");
    const auto points = pointsOf(outcome.out);
    ASSERT_EQ(points.size(), 201u);
    EXPECT_LT((points[0] - Eigen::Vector4d(0, 0.35, 0.03, -0.02)).norm(), 1e-12);
    EXPECT_LT((points[50] - Eigen::Vector4d(2, 0.35, 0.01, 0)).norm(), 1e-12);
  }
}

}  // namespace
}  // namespace helix_arm::test
