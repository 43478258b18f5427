#include <gtest/gtest.h>

#include "command.hpp"
#include "helix_arm/control/tip_path.hpp"
#include "helix_arm/io/tip_path_file.hpp"
#include "support/temporary_folder.hpp"

namespace helix_arm::test {
namespace {

using nlohmann::json;

// A shape of radius 0.02 m around (0.35, 0.01, -0.02) m, 8 s a turn.
Outcome path(const std::string& shape, const std::vector<std::string>& more = {}) {
  return runCommand(
      {"path", shape, "--centre", "0.35,0.01,-0.02", "--radius", "0.02", "--period", "8"}, more);
}

// The rows of a path file below its header.
std::vector<std::vector<double>> pointsOf(const std::string& text) {
  const auto rows = csvRows(text);
  EXPECT_EQ(rows.at(0), (std::vector<std::string>{"time_s", "x_m", "y_m", "z_m"}));
  std::vector<std::vector<double>> points;
  for (std::size_t i = 1; i < rows.size(); ++i) {
    points.emplace_back();
    for (const std::string& cell : rows[i]) points.back().push_back(std::stod(cell));
  }
  return points;
}

void expectPoint(const std::vector<double>& point, double time, double x, double y, double z) {
  ASSERT_EQ(point.size(), 4u);
  EXPECT_NEAR(point[0], time, 1e-12);
  EXPECT_NEAR(point[1], x, 1e-12);
  EXPECT_NEAR(point[2], y, 1e-12);
  EXPECT_NEAR(point[3], z, 1e-12);
}

TEST(Path, ACircleIsPrintedAsAPathFile) {
  for (const char* format : {"text", "csv"}) {
    const Outcome outcome = path("circle", {"--format", format});
    ASSERT_EQ(outcome.exit_code, 0) << outcome.err;
    EXPECT_EQ(outcome.err, "");
    const auto points = pointsOf(outcome.out);
    ASSERT_EQ(points.size(), 201u);
    expectPoint(points[0], 0, 0.35, 0.03, -0.02);
    expectPoint(points[50], 2, 0.35, 0.01, 0);
  }
}

TEST(Path, AFileHasTheSameContentAsStdoutAndIsAPath) {
  const TemporaryFolder folder;
  const std::string file = folder / "circle.csv";
  ASSERT_EQ(path("circle", {"--out", file}).exit_code, 0);
  EXPECT_EQ(contentOf(file), path("circle").out);
  const control::TipPath read(io::loadTipPath(io::loadDataSet(file)));
  EXPECT_EQ(read.lastTime(), 8.0);
  const Outcome csv = path("square", {"--turns", "2", "--out", file, "--format", "csv"});
  EXPECT_EQ(csv.out, "shape,points,duration_s,out\nsquare,401,16," + file + "\n");
  EXPECT_EQ(contentOf(file), path("square", {"--turns", "2"}).out);
}

TEST(Path, JsonHasThePointsOrTheFile) {
  std::vector<std::string> asked{"--turns", "2", "--plane", "xz"};
  const auto last = pointsOf(path("lemniscate", asked).out).back();
  asked.insert(asked.end(), {"--format", "json"});
  const json printed = path("lemniscate", asked).json();
  const json expected{
      {"shape", "lemniscate"}, {"radius_m", 0.02}, {"period_s", 8.0},    {"turns", 2},
      {"plane", "xz"},         {"points", 401},    {"duration_s", 16.0}, {"out", nullptr}};
  for (const auto& [key, value] : expected.items()) EXPECT_EQ(printed[key], value) << key;
  EXPECT_EQ(numbersOf(printed["centre_m"]), (std::vector<double>{0.35, 0.01, -0.02}));
  ASSERT_EQ(printed["time_s"].size(), 401u);
  EXPECT_EQ(printed["time_s"].back(), last[0]);
  EXPECT_EQ(numbersOf(printed["position_m"].back()),
            std::vector<double>(last.begin() + 1, last.end()));
  const TemporaryFolder folder;
  const json written = path("circle", {"--out", folder / "c.csv", "--format", "json"}).json();
  EXPECT_EQ(written["out"], folder / "c.csv");
  EXPECT_TRUE(written["time_s"].is_null());
  EXPECT_TRUE(written["position_m"].is_null());
}

}  // namespace
}  // namespace helix_arm::test
