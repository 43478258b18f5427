// Data sets of tags: their corners in pictures, and their poses.
#include "helix_arm/io/tag_table.hpp"

#include <stdexcept>

#include <gtest/gtest.h>

#include "helix_arm/control/tip_path.hpp"
#include "io/data/tip_path_file.hpp"
#include "support/random.hpp"
#include "support/table_faults.hpp"
#include "support/temporary_file.hpp"

namespace helix_arm::io {
namespace {

const std::string kCornerHeader =
    "capture,pressure_1_kpa,pressure_2_kpa,tag,x1_px,y1_px,x2_px,y2_px,x3_px,y3_px,x4_px,y4_px\n";

std::vector<TagCornerCapture> loadCorners(const std::string& text) {
  return loadTagCorners(loadDataSet(test::TemporaryFile(text).path()), 2);
}

TEST(TagCorners, RowsOfACaptureBelongTogether) {
  const auto captures = loadCorners("# comment\n" + kCornerHeader +
                                    "7,10,20,3,1,2,3,4,5,6,7,8.5\n"
                                    "2,0,5,3,0,0,1,0,1,1,0,1\n"
                                    "7,10,20,0,-1,0,0,0,0,0,0,0\n");
  ASSERT_EQ(captures.size(), 2u);
  EXPECT_EQ(captures[0].number, 7);
  EXPECT_EQ(captures[0].pressure, Eigen::VectorXd(Eigen::Vector2d(10e3, 20e3)));
  ASSERT_EQ(captures[0].tags.size(), 2u);
  EXPECT_EQ(captures[0].tags[0].id, 3);
  EXPECT_EQ(captures[0].tags[0].line, 3);
  EXPECT_EQ(captures[0].tags[1].line, 5);
  estimation::Corners expected;
  expected << 1, 3, 5, 7, 2, 4, 6, 8.5;
  EXPECT_EQ(captures[0].tags[0].corners, expected);
  EXPECT_EQ(captures[1].number, 2);
}

TEST(TagCorners, WrittenCornersReadBackToTheLastBit) {
  test::Random random(8);
  std::vector<TagCornerCapture> captures;
  for (int number : {4, 0, 12}) {
    TagCornerCapture capture{number, Eigen::Vector2d(random.uniform(0, 4e5), 413685.6), {}};
    // A pressure that some number of kPa gives, as those of files and commands are.
    capture.pressure[0] = 1e3 * (capture.pressure[0] / 1e3);
    for (int id = 0; id < 5; ++id) {
      TagCorners tag{id, {}};
      for (int i = 0; i < tag.corners.size(); ++i) tag.corners(i) = random.uniform(-10, 2000);
      capture.tags.push_back(tag);
    }
    captures.push_back(capture);
  }
  captures.push_back({13, Eigen::Vector2d(0, 0), {}});  // saw nothing
  const std::string text = tagCornerCsv(captures, 2, "two\nlines");
  EXPECT_EQ(text.find("# two\n# lines\n" + kCornerHeader), 0u) << text.substr(0, 200);
  const auto read = loadCorners(text);
  ASSERT_EQ(read.size(), 3u);
  for (std::size_t c = 0; c < read.size(); ++c) {
    EXPECT_EQ(read[c].number, captures[c].number);
    EXPECT_EQ(read[c].pressure, captures[c].pressure);
    ASSERT_EQ(read[c].tags.size(), captures[c].tags.size());
    for (std::size_t i = 0; i < read[c].tags.size(); ++i) {
      EXPECT_EQ(read[c].tags[i].id, captures[c].tags[i].id);
      EXPECT_EQ(read[c].tags[i].corners, captures[c].tags[i].corners);
    }
  }
  EXPECT_EQ(tagCornerCsv({}, 2, ""), kCornerHeader);
  EXPECT_THROW(tagCornerCsv(captures, 3, ""), std::invalid_argument);
}

const std::string kPoseHeader =
    "capture,pressure_1_kpa,pressure_2_kpa,tag,x_m,y_m,z_m,qx,qy,qz,qw\n";

std::vector<TagPoseCapture> loadPoses(const std::string& text, const lie::SE3& X_BF = {}) {
  return loadTagPoses(loadDataSet(test::TemporaryFile(text).path()), 2, X_BF);
}

std::string poseFaults(const std::string& text) {
  return test::tableFaults(
      text, [](const std::string& path) { loadTagPoses(loadDataSet(path), 2, lie::SE3()); });
}

TEST(TagPoses, AreConvertedToTheBaseFromAnyFrame) {
  // F is turned by 90 degrees about the base's z axis: its x axis is the base's y axis.
  Eigen::Matrix3d R;
  R << 0, -1, 0, 1, 0, 0, 0, 0, 1;
  const auto captures = loadPoses(kPoseHeader + "1,0,0,3,0.3,0.2,0.1,0,0,0,1\n", {R, {1, 2, 3}});
  const lie::SE3& X_BT = captures[0].tags[0].X_BT;
  EXPECT_LT((X_BT.translation - Eigen::Vector3d(0.8, 2.3, 3.1)).norm(), 1e-15);
  EXPECT_LT((X_BT.rotation - R).norm(), 1e-15);
}

TEST(TagPoses, AllFaultsAreReportedWithTheirLines) {
  EXPECT_EQ(
      poseFaults(kPoseHeader + "1,0,0,3,0,0,0,0,0,0,1\n"
                               "1,0,0,3,0,0,0,0,0,0,1\n"
                               "1,0,5,4,0,0,0,0,0,0,1\n"
                               "1.5,0,0,4,0,0,0,0,0,0,1\n"
                               "2,0,0,-1,0,0,0,0,0,0,1\n"
                               "2,0,0,5,0,0,0,0,0,0,0.5\n"
                               "2,0,0,6,0,0,0,0,0,0,0\n"),
      ":3 measures the tag of line 2 again in the same capture; expected it once\n:4 has other "
      "pressures than its capture; expected those of line 2\n:5 capture is not a whole number from "
      "0 to 1000000000\n:6 tag is not a whole number from 0 to 1000000000\n:7 has a quaternion qx, "
      "qy, qz, qw that is not of norm 1\n:8 has a quaternion qx, qy, qz, qw that is not of norm 1");
}

// ---- Paths of the tip ---------------------------------------------------------------------------

using control::TipWayPoint;
using Eigen::Vector3d;

const std::string kHeader = "time_s,x_m,y_m,z_m\n";

std::vector<TipWayPoint> load(const std::string& text) {
  return loadTipPath(loadDataSet(test::TemporaryFile(text).path()));
}

void expectSame(const std::vector<TipWayPoint>& read, const std::vector<TipWayPoint>& written) {
  ASSERT_EQ(read.size(), written.size());
  for (std::size_t i = 0; i < read.size(); ++i) {
    EXPECT_EQ(read[i].time, written[i].time);
    EXPECT_EQ(read[i].position, written[i].position);
    EXPECT_FALSE(read[i].rotation || read[i].velocity);
  }
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

TEST(TipPathFile, TimesAscendByTheShortestStep) {
  const auto faultsOf = [](const std::string& rows) {
    return test::tableFaults(kHeader + rows,
                             [](const std::string& path) { loadTipPath(loadDataSet(path)); });
  };
  EXPECT_EQ(faultsOf("0,0,0,0\n1e-6,0,0,0\n"), "");
  EXPECT_EQ(faultsOf("0.5,0,0,0\n0.5,0,0,0\n"),
            ":3 time_s is not at least 1e-06 s after line 2; expected ascending times");
}

}  // namespace
}  // namespace helix_arm::io
