#include "helix_arm/io/tip_path_file.hpp"

#include <cmath>

#include <gtest/gtest.h>

#include "helix_arm/control/tip_path.hpp"
#include "helix_arm/io/fault_list.hpp"
#include "support/random.hpp"
#include "support/table_faults.hpp"
#include "support/temporary_file.hpp"

namespace helix_arm::io {
namespace {

using control::TipWayPoint;
using Eigen::Vector3d;

const std::string kHeader = "time_s,x_m,y_m,z_m\n";

std::vector<TipWayPoint> load(const std::string& text) {
  return loadTipPath(loadDataSet(test::TemporaryFile(text).path()));
}

std::string faultsOf(const std::string& text) {
  return test::tableFaults(text, [](const std::string& path) { loadTipPath(loadDataSet(path)); });
}

void expectSame(const std::vector<TipWayPoint>& read, const std::vector<TipWayPoint>& written) {
  ASSERT_EQ(read.size(), written.size());
  for (std::size_t i = 0; i < read.size(); ++i) {
    EXPECT_EQ(read[i].time, written[i].time);
    EXPECT_EQ(read[i].position, written[i].position);
    EXPECT_FALSE(read[i].rotation || read[i].velocity);
  }
}

TEST(TipPathFile, ReadsTheFourColumnsWhereverTheyStand) {
  const auto points = load(
      "# comment\nz_m,pressure_1_kpa,time_s,x_m,y_m\n0.3,7,0,0.1,0.2\n"
      "-0.3,8,1.5,-0.1,1e-3\n");
  ASSERT_EQ(points.size(), 2u);
  EXPECT_EQ(points[0].time, 0.0);
  EXPECT_EQ(points[1].time, 1.5);
  EXPECT_EQ(points[0].position, Vector3d(0.1, 0.2, 0.3));
  EXPECT_EQ(points[1].position, Vector3d(-0.1, 1e-3, -0.3));
  EXPECT_FALSE(points[0].rotation || points[0].velocity);
}

TEST(TipPathFile, WhatIsWrittenIsReadAsTheSame) {
  test::Random random(1);
  std::vector<TipWayPoint> points;
  for (double time = random.uniform(0, 1); points.size() < 500; time += random.uniform(1e-3, 1)) {
    points.push_back({time, random.logUniform(1e-9, 1e5) * random.direction<3>()});
  }
  expectSame(load(tipPathCsv(points, "")), points);
  const auto circle = control::wayPointsOf({control::TipShape::kCircle, {0.4, 0, 0}, 0.02, 8.0});
  expectSame(load(tipPathCsv(circle, "two\nlines")), circle);
  EXPECT_EQ(tipPathCsv({{0, {0.4, 0, -0.5}}, {0.1, {1, 2, 3}}}, "two\nlines"),
            "# two\n# lines\ntime_s,x_m,y_m,z_m\n0,0.4,0,-0.5\n0.1,1,2,3\n");
}

TEST(TipPathFile, AllFaultsAreReportedWithTheirLines) {
  EXPECT_EQ(faultsOf("# c\n" + kHeader +
                     "-0.1,0,0,0\n"
                     "1,0,0,0\n"
                     "0.5,0,0,0\n"
                     "0.5,0,0,0\n"
                     "2,0,0,0\n"
                     "# between\n"
                     "2,3e6,0,-3e6\n"
                     "1e7,0,0,0\n"),
            ":3 time_s is not within 0 to 1000000; expected the time since the start of the path\n"
            ":5 time_s is not at least 1e-06 s after line 4; expected ascending times\n"
            ":6 time_s is not at least 1e-06 s after line 5; expected ascending times\n"
            ":9 time_s is not at least 1e-06 s after line 7; expected ascending times\n"
            ":9 x_m is beyond 1000000; expected metres from the arm's base\n"
            ":9 z_m is beyond 1000000; expected metres from the arm's base\n"
            ":10 time_s is not within 0 to 1000000; expected the time since the start of the path");
  EXPECT_EQ(faultsOf(kHeader + "0,0,0,nan\n1,inf,,0\nx,0,0,0\n"),
            ":2 z_m is not a finite number; expected one\n:3 x_m is not a finite number; expected "
            "one\n:3 y_m is empty; expected a finite number\n:4 time_s is not a finite number; "
            "expected one");
}

TEST(TipPathFile, MissingColumnsAreNamed) {
  const std::string expected = "; expected time_s, x_m, y_m, z_m";
  EXPECT_EQ(faultsOf("time,x_m,z_m\n0,0,0\n1,0,0\n"), " has no column time_s, y_m" + expected);
  EXPECT_EQ(faultsOf("pressure_1_kpa,curvature_rad\n0,0\n"),
            " has no column time_s, x_m, y_m, z_m" + expected);
}

TEST(TipPathFile, EveryLimitIsKeptFromBothSides) {
  const auto rows = [](int count) {
    std::string text = kHeader;
    for (int i = 0; i < count; ++i) text += std::to_string(i) + ",0,0,0\n";
    return text;
  };
  const std::string rule = "; expected 2 to 100000 points of a path";
  EXPECT_EQ(faultsOf(rows(0)), " has no rows; expected at least one below the header");
  EXPECT_EQ(faultsOf(rows(1)), " has 1 row" + rule);
  EXPECT_EQ(faultsOf(rows(2)), "");
  EXPECT_EQ(faultsOf(rows(100'000)), "");
  EXPECT_EQ(faultsOf(rows(100'001)), " has 100001 rows" + rule);
  EXPECT_EQ(faultsOf(kHeader + "0,1e6,-1e6,1e6\n1e6,0,0,0\n"), "");
  EXPECT_NE(faultsOf(kHeader + "0,1000000.1,0,0\n1,0,0,0\n"), "");
  EXPECT_NE(faultsOf(kHeader + "0,0,0,0\n1000000.1,0,0,0\n"), "");
  EXPECT_EQ(faultsOf(kHeader + "0,0,0,0\n1e-6,0,0,0\n"), "");
  EXPECT_NE(faultsOf(kHeader + "0,0,0,0\n0.99e-6,0,0,0\n"), "");
}

// The rules of the file are those of the path.
TEST(TipPathFile, APathIsMadeOfWhateverIsRead) {
  test::Random random(2);
  const double kEdges[] = {0, 1e-7, 1e-6, 1e6, -1e6, 1e6 + 1, -1e-7, -1e7, 1e300};
  DataSet data;
  data.columns = {"time_s", "x_m", "y_m", "z_m"};
  data.lines = {2, 3, 4};
  data.values.resize(3, 4);
  int accepted = 0;
  for (int k = 0; k < 20'000; ++k) {
    for (int i = 0; i < data.values.size(); ++i) {
      const bool edge = random.integer(0, 2) == 0;
      data.values(i) = edge ? kEdges[random.integer(0, 8)] : random.uniform(-10, 1000);
    }
    if (random.integer(0, 1) == 0) data.values(1, 0) = data.values(0, 0) + 1.000001e-6;
    std::vector<TipWayPoint> points;
    try {
      points = loadTipPath(data);
    } catch (const DocumentError&) {
      continue;
    }
    EXPECT_NO_THROW(control::TipPath path(points));
    ++accepted;
  }
  EXPECT_GT(accepted, 500);
}

}  // namespace
}  // namespace helix_arm::io
