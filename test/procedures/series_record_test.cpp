#include <algorithm>
#include <cmath>
#include <sstream>

#include <gtest/gtest.h>

#include "helix_arm/io/data_set.hpp"
#include "helix_arm/procedures/response_series.hpp"
#include "support/random.hpp"

namespace helix_arm::procedures {
namespace {

constexpr double kReading = 0.01;  // period [s]
constexpr double kPicture = 0.05;
constexpr double kLate = 0.06;  // of a tip

Eigen::Vector2d pressureAt(double time) { return {1e4 * time, 2e5 - 1e4 * time}; }
Eigen::Vector3d tipAt(double time) { return {0.4, 0.01 * time, -0.02 * time}; }

const Eigen::VectorXd kPressure = Eigen::VectorXd::Constant(1, 1e5);

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

auto trialsOf(const SeriesRecord& record) {
  const std::vector<bool> starts = record.series().history.starts_anew;
  return std::count(starts.begin(), starts.end(), true);
}

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

TEST(SeriesRecord, KnowsThePressuresWhileNoPictureComes) {
  Arm arm;
  arm.run(2);
  arm.run(4, false);
  arm.run(2);
  const ResponseSeries series = arm.record.series();
  expectAscending(series.history);
  const double blind = 1.7e9 + 2, sighted = 1.7e9 + 6;
  int rows = 0;
  for (Eigen::Index row = 1; row < series.history.rows(); ++row) {
    const auto k = static_cast<std::size_t>(row);
    const double time = series.history.time[k];
    EXPECT_FALSE(series.history.starts_anew[k]);
    EXPECT_LE(time - series.history.time[k - 1], SeriesRecord::kSpacing + 1e-6) << row;
    if (time <= blind + 1e-3 || time >= sighted) continue;
    EXPECT_FALSE(seen(series, row));
    ++rows;
  }
  EXPECT_NEAR(rows, 4 / SeriesRecord::kSpacing, 4);
}

TEST(SeriesRecord, AveragesTheNoiseOfTheReadings) {
  test::Random random(3);
  SeriesRecord record(1);
  for (int k = 0; k < 2000; ++k) {
    record.measured(kReading * k, Eigen::VectorXd::Constant(1, 1e5 + 5e3 * random.normal()));
  }
  const Eigen::VectorXd pressure = record.series().history.input.col(0);
  const double deviation = std::sqrt((pressure.array() - 1e5).square().mean());
  // 21 readings each.
  EXPECT_NEAR(deviation, 5e3 / std::sqrt(21), 0.25 * 5e3 / std::sqrt(21));
}

TEST(SeriesRecord, ATimeThatGoesBackStartsANewTrial) {
  SeriesRecord record(1);
  for (const double start : {100.0, 50.0}) {
    for (int k = 0; k < 300; ++k) {
      record.measured(start + kReading * k, kPressure);
      if (k % 5 == 0) record.seen(start + kReading * k, tipAt(0));
    }
  }
  const ResponseSeries series = record.series();
  expectAscending(series.history);
  int tips = 0;
  for (std::size_t k = 0; k < series.history.time.size(); ++k) {
    tips += series.history.time[k] < 99 && seen(series, static_cast<Eigen::Index>(k));
  }
  EXPECT_EQ(trialsOf(record), 2);
  EXPECT_NEAR(tips, 60, 1) << "of the second trial";
}

TEST(SeriesRecord, PressuresThatAreMissingForLongStartANewTrial) {
  SeriesRecord record(1);
  double time = 0;
  const auto go = [&](double gap) {
    time += gap;
    for (int k = 0; k < 100; ++k) record.measured(time += kReading, kPressure);
  };
  go(0);
  go(0.9 * SeriesRecord::kGap);
  EXPECT_EQ(trialsOf(record), 1);
  go(1.1 * SeriesRecord::kGap);
  EXPECT_EQ(trialsOf(record), 2);
}

TEST(SeriesRecord, LeavesOutTipsThatAreLateTwiceOrNotFinite) {
  SeriesRecord record(1);
  for (double time = 0; time < 5; time += kReading) record.measured(time, kPressure);
  for (const double time : {4.5, 4.5, 4.4, 1.0}) record.seen(time, tipAt(0));
  record.seen(4.6, {0.4, std::nan(""), 0});
  for (double time = 5; time < 6; time += kReading) record.measured(time, kPressure);
  EXPECT_EQ(record.tips(), 1u);
  expectAscending(record.series().history);
}

TEST(SeriesRecord, HasAsManyRowsAsADataSetMayHave) {
  SeriesRecord record(1);
  const int more = 1000;
  for (std::size_t k = 0; k < SeriesRecord::kMostRows + more; ++k) {
    record.measured(SeriesRecord::kSpacing * static_cast<double>(k), kPressure);
  }
  EXPECT_EQ(record.rows(), SeriesRecord::kMostRows);
  EXPECT_EQ(record.series().history.rows(), static_cast<Eigen::Index>(SeriesRecord::kMostRows));
  EXPECT_GT(record.leftOut(), more / 2u);
}

TEST(SeriesRecord, RefusesPressuresOfAnotherArm) {
  EXPECT_THROW(SeriesRecord(0), std::invalid_argument);
  SeriesRecord record(2);
  EXPECT_THROW(record.measured(0, Eigen::Vector3d::Zero()), std::invalid_argument);
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
