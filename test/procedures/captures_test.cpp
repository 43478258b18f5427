#include "procedures/captures.hpp"

#include <cmath>
#include <sstream>

#include <gtest/gtest.h>

#include "helix_arm/io/data_set.hpp"
#include "helix_arm/localization/tag_layout.hpp"
#include "procedures/response_series.hpp"
#include "support/scene_text.hpp"
#include "support/table_faults.hpp"
#include "support/temporary_file.hpp"

namespace helix_arm::procedures {
namespace {

using namespace test;

// Six pressure actuators: three of 0 to 300 kPa, then bellows of 0 to 100, 10 to 90 and 0 to 100.
const std::string kPressures =
    "pressure_1_kpa,pressure_2_kpa,pressure_3_kpa,pressure_4_kpa,pressure_5_kpa,pressure_6_kpa";
const std::string kPoseHeader = "capture," + kPressures + ",tag,x_m,y_m,z_m,qx,qy,qz,qw\n";
const std::string kCornerHeader =
    "capture," + kPressures + ",tag,x1_px,y1_px,x2_px,y2_px,x3_px,y3_px,x4_px,y4_px\n";

io::Scene sceneOf(const std::string& text, const std::vector<io::Override>& overrides = {}) {
  return io::loadScene(test::TemporaryFile(text).path(), overrides);
}

LoadedCaptures load(const io::Scene& scene, const std::string& data) {
  return loadCaptures(scene, io::loadDataSet(test::TemporaryFile(data).path()));
}

std::string faultsOf(const io::Scene& scene, const std::string& data) {
  return test::tableFaults(
      data, [&scene](const std::string& path) { loadCaptures(scene, io::loadDataSet(path)); });
}

TEST(Captures, PosesAreThoseOfTheLayoutSeenFromTheBase) {
  const io::Scene scene = sceneOf(kSpatialScene, {{"tags.frame", "{position_m: [0.1, 0, 0]}"}});
  const auto loaded = load(scene, kPoseHeader +
                                      "5,1,2,3,4,50,6,1,0.1,0.2,0.3,0,0,0,1\n"
                                      "5,1,2,3,4,50,6,17,0,0,0,0,0,0,1\n"
                                      "5,1,2,3,4,50,6,3,0,0,0,0,0,0,1\n"
                                      "9,0,0,0,0,50,0,17,0,0,0,0,0,0,1\n");
  ASSERT_EQ(loaded.captures.size(), 2u);
  const auto& seen = std::get<std::vector<estimation::PoseObservation>>(loaded.captures[0].reading);
  ASSERT_EQ(seen.size(), 2u);
  EXPECT_EQ(seen[0].tag, scene.tags->find(1));
  EXPECT_EQ(seen[0].X_BT.translation, Eigen::Vector3d(0.1 + 0.1, 0.2, 0.3));
  EXPECT_EQ(seen[1].tag, scene.tags->find(3));
  EXPECT_EQ(loaded.captures[0].pressure[4], 50e3);
  EXPECT_TRUE(
      std::get<std::vector<estimation::PoseObservation>>(loaded.captures[1].reading).empty());
  EXPECT_EQ(loaded.unknown_ids, std::vector<int>{17});
}

TEST(Captures, CornersAreUndistorted) {
  const io::Scene scene = sceneOf(kSpatialScene);
  const auto loaded =
      load(scene, kCornerHeader + "1,0,0,0,0,50,0,0,100,110,120,130,140,150,160,170\n");
  const auto& seen =
      std::get<std::vector<estimation::CornerObservation>>(loaded.captures[0].reading);
  ASSERT_EQ(seen.size(), 1u);
  EXPECT_EQ(seen[0].tag, scene.tags->find(0));
  for (int i = 0; i < 4; ++i) {
    const Eigen::Vector2d pixel = scene.camera->model.pixelOf(seen[0].direction.col(i));
    EXPECT_LT((pixel - Eigen::Vector2d(100 + 20 * i, 110 + 20 * i)).norm(), 1e-9);
  }
}

TEST(Captures, WhatDoesNotFitItsSceneIsAFault) {
  const io::Scene planar = sceneOf(kPlanarScene), spatial = sceneOf(kSpatialScene);
  const std::string row = "1,0,0,0,0,50,0,1,0,0,0,0,0,0,1\n";
  const struct {
    const io::Scene& scene;
    std::string data, faults;
  } cases[] = {
      {planar, "pressure_1_kpa,pressure_3_kpa,curvature_rad\n0,0,0.1\n",
       " column 'pressure_3_kpa' belongs to no actuator; expected pressures in pressure_1_kpa to "
       "pressure_2_kpa"},
      {spatial,
       kPoseHeader + "1,0,0,0,0,50,0,20,0,0,0,0,0,0,1\n" + "1,0,0,0,0,50,0,18,0,0,0,0,0,0,1\n",
       " holds no tag of scene rig but only 18, 20; expected 3, 1, 0: is it of another arm?"},
      {planar, "pressure_1_kpa,pressure_2_kpa,curvature_rad\n0,401,0.1\n-1,0,0.1\n0,0,0\n",
       ":2 pressure_2_kpa is not within the limits of muscle_2, 0 kPa to 400 kPa\n"
       ":3 pressure_1_kpa is not within the limits of muscle_1, 0 kPa to 400 kPa"},
      {spatial, kPoseHeader + row + row,
       ":3 measures the tag of line 2 again in the same capture; expected it once"},
  };
  for (const auto& [scene, data, faults] : cases) EXPECT_EQ(faultsOf(scene, data), faults);
}

constexpr double kReading = 0.01;  // period [s]
constexpr double kPicture = 0.05;
constexpr double kLate = 0.06;  // of a tip

Eigen::Vector2d pressureAt(double time) { return {1e4 * time, 2e5 - 1e4 * time}; }
Eigen::Vector3d tipAt(double time) { return {0.4, 0.01 * time, -0.02 * time}; }

bool seen(const ResponseSeries& series, Eigen::Index row) {
  return series.reading.row(row).allFinite();
}

// Readings and tips, whose pictures are lost in between.
class Arm {
 public:
  void run(double seconds, bool sees = true) {
    const int steps = static_cast<int>(std::lround(seconds / kReading));
    for (int k = 0; k < steps; ++k) {
      ++step_;
      record.measured(now(), pressureAt(now()));
      if (step_ % 5 == 0 && sees) stamps_.push_back(now());
      while (!stamps_.empty() && stamps_.front() + kLate <= now()) {
        record.seen(stamps_.front(), tipAt(stamps_.front()));
        stamps_.pop_front();
      }
    }
  }
  double now() const { return 1.7e9 + kReading * step_; }

  SeriesRecord record{2};

 private:
  int step_ = 0;
  std::deque<double> stamps_;
};

void expectAscending(const model::InputHistory& history) {
  for (std::size_t k = 1; k < history.time.size(); ++k) {
    EXPECT_TRUE(history.starts_anew[k] || history.time[k] > history.time[k - 1]) << k;
  }
}

TEST(SeriesRecord, JoinsEveryTipWithThePressuresAtItsTime) {
  Arm arm;
  arm.run(5);
  const ResponseSeries series = arm.record.series();
  expectAscending(series.history);
  int tips = 0;
  for (Eigen::Index row = 0; row < series.history.rows(); ++row) {
    const double time = series.history.time[static_cast<std::size_t>(row)];
    EXPECT_EQ(series.history.starts_anew[static_cast<std::size_t>(row)], row == 0);
    // At both ends, the mean is one-sided.
    if (row > 5 && row < series.history.rows() - 10) {
      EXPECT_LT((series.history.input.row(row).transpose() - pressureAt(time)).norm(), 100) << row;
    }
    if (!seen(series, row)) continue;
    ++tips;
    EXPECT_EQ(series.reading.row(row).transpose(), tipAt(time));
  }
  EXPECT_NEAR(tips, 5 / kPicture, 2);
  EXPECT_EQ(arm.record.leftOut(), 0u);
}

TEST(SeriesRecord, IsReadBackAsItWasWritten) {
  Arm arm;
  arm.run(2);
  arm.run(0.3, false);
  arm.run(1);
  const ResponseSeries series = arm.record.series();
  std::istringstream text(tipSeriesCsv(series, "recorded"));
  const ResponseSeries read = tipSeriesOf(io::readDataSet(text, "series.csv"), 2);
  ASSERT_EQ(read.history.rows(), series.history.rows());
  EXPECT_EQ(read.history.starts_anew, series.history.starts_anew);
  for (Eigen::Index row = 0; row < read.history.rows(); ++row) {
    const auto k = static_cast<std::size_t>(row);
    EXPECT_NEAR(read.history.time[k], series.history.time[k], 1e-6);
    EXPECT_LT((read.history.input.row(row) - series.history.input.row(row)).norm(), 1e-3);
    ASSERT_EQ(seen(read, row), seen(series, row)) << row;
    if (!seen(read, row)) continue;
    EXPECT_LT((read.reading.row(row) - series.reading.row(row)).norm(), 1e-6);
  }
}

}  // namespace
}  // namespace helix_arm::procedures
