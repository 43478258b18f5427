#include "helix_arm/procedures/tip_record.hpp"

#include <cmath>
#include <sstream>
#include <vector>

#include <gtest/gtest.h>

namespace helix_arm::procedures {
namespace {

Eigen::VectorXd vector(std::initializer_list<double> values) {
  Eigen::VectorXd out(static_cast<Eigen::Index>(values.size()));
  std::copy(values.begin(), values.end(), out.data());
  return out;
}

TEST(TimeSeries, IsLinearBetweenItsValues) {
  TimeSeries series;
  EXPECT_FALSE(series.between(0));
  for (const double t : {10.0, 10.1, 10.2}) series.add(t, vector({t, -3 * t}));
  for (const double t : {10.0, 10.03, 10.1, 10.17, 10.2}) {
    const auto value = series.between(t);
    ASSERT_TRUE(value) << t;
    EXPECT_NEAR((*value - vector({t, -3 * t})).norm(), 0, 1e-12) << t;
  }
  EXPECT_FALSE(series.between(9.99)) << "before all values";
}

TEST(TimeSeries, TheNewestHoldsForAMomentAlone) {
  TimeSeries series;
  series.add(10, vector({1}));
  EXPECT_TRUE(series.between(10 + TimeSeries::kAhead - 1e-6));
  EXPECT_FALSE(series.between(10 + TimeSeries::kAhead + 1e-6));
  EXPECT_TRUE(series.covers(10));
  EXPECT_FALSE(series.covers(10 + 1e-6));
}

TEST(TimeSeries, LongGapsAreNotBridged) {
  for (const double beyond : {-1e-3, 1e-3}) {
    TimeSeries series;
    series.add(10, vector({1}));
    series.add(10 + TimeSeries::kReach + beyond, vector({2}));
    EXPECT_EQ(series.between(10.1).has_value(), beyond < 0);
  }
}

TEST(TimeSeries, ACommandIsInForceUntilTheNext) {
  TimeSeries series;
  series.add(10, vector({1}));
  series.add(10.5, vector({2}));
  EXPECT_FALSE(series.inForce(9.9));
  EXPECT_EQ(series.inForce(10), vector({1}));
  EXPECT_EQ(series.inForce(10.499), vector({1}));
  EXPECT_EQ(series.inForce(10.5), vector({2}));
  EXPECT_EQ(series.inForce(11.499), vector({2}));
  EXPECT_FALSE(series.inForce(11.501));
}

TEST(TimeSeries, AJumpBackOrAnotherSizeStartsAnew) {
  TimeSeries series;
  series.add(10, vector({1}));
  series.add(5, vector({2}));
  EXPECT_FALSE(series.covers(6));
  EXPECT_EQ(series.inForce(5), vector({2}));
  series.add(5.1, vector({1, 2}));
  EXPECT_FALSE(series.inForce(5));
  EXPECT_EQ(series.inForce(5.1), vector({1, 2}));
}

// Wanted at 0, measured 3 mm from it and predicted 2 mm.
TipRow rowAt(double stamp, double path_time) {
  return {stamp,
          path_time,
          Eigen::Vector3d::Zero(),
          Eigen::Vector3d(0, 0.003, 0),
          Eigen::Vector3d(0, 0, 0.002),
          1e-4,
          "closed"};
}

// What all topics say of a time.
void say(TipRecord& record, double time) {
  record.model.add(time, Eigen::Vector3d(time, 0, 0));
  record.command.add(time, vector({1e3 * time, 1}));
  record.pressure.add(time, vector({1e4 * time, 2}));
}

TEST(TipRecord, RowsHaveWhatWasAtTheTimeOfTheirPictures) {
  TipRecord record;
  for (const double t : {1.0, 1.1, 1.2}) say(record, t);
  record.add(rowAt(1.15, 0.15));
  EXPECT_TRUE(record.isComplete());
  const TipRow& row = record.finish().at(0);
  ASSERT_TRUE(row.model && row.command && row.pressure);
  EXPECT_NEAR(row.model->x(), 1.15, 1e-12);
  EXPECT_EQ((*row.command)[0], 1100) << "in force, not interpolated";
  EXPECT_NEAR((*row.pressure)[0], 11500, 1e-8);
  EXPECT_EQ(row.error(), 0.003);
}

TEST(TipRecord, ARowWaitsUntilAllHasCome) {
  TipRecord record;
  say(record, 1.0);
  record.add(rowAt(1.05, 0));
  EXPECT_FALSE(record.isComplete());
  record.model.add(1.1, Eigen::Vector3d(1.1, 0, 0));
  record.command.add(1.1, vector({1, 1}));
  record.update();
  EXPECT_FALSE(record.isComplete()) << "the pressures of its time have not come";
  record.pressure.add(1.1, vector({2e4, 2}));
  record.update();
  EXPECT_TRUE(record.isComplete());
  EXPECT_NEAR((*record.finish().at(0).pressure)[0], 15000, 1e-8);
}

TEST(TipRecord, WhatDoesNotComeIsLeftOut) {
  TipRecord record;
  record.command.add(1.0, vector({5, 6}));
  for (int k = 0; k < 3; ++k) record.add(rowAt(1.0 + 0.1 * k, 0.1 * k));
  EXPECT_FALSE(record.isComplete());
  const auto& rows = record.finish();
  ASSERT_EQ(rows.size(), 3U);
  for (const TipRow& row : rows) {
    EXPECT_FALSE(row.model);
    EXPECT_FALSE(row.pressure);
    EXPECT_EQ(row.command, vector({5, 6}));
  }
}

TEST(TipRecord, ItsBuffersAreBounded) {
  TipRecord record;
  for (std::size_t k = 0; k < TipRecord::kMostRows + 5; ++k) {
    record.add(rowAt(1e-3 * static_cast<double>(k), 0));
  }
  EXPECT_EQ(record.leftOut(), 5U);
  EXPECT_EQ(record.finish().size(), TipRecord::kMostRows);
  TimeSeries series;
  for (std::size_t k = 0; k < TimeSeries::kMost + 5; ++k) {
    series.add(0.01 * static_cast<double>(k), vector({1}));
  }
  EXPECT_FALSE(series.inForce(0.04));
  EXPECT_TRUE(series.inForce(0.05));
}

TEST(TipRecord, ErrorsAreThoseOnThePath) {
  std::vector<TipRow> rows = {rowAt(1, -0.1), rowAt(2, 0), rowAt(3, 1), rowAt(4, 1.1)};
  rows[0].measured.y() = rows[3].measured.y() = 1;  // on the way to it, and after its end
  rows[2].measured.y() = 0.004;
  const auto measured = errorOf(rows, RecordedTip::kMeasured, 1.0);
  ASSERT_TRUE(measured);
  EXPECT_NEAR(measured->rms, std::sqrt((9e-6 + 16e-6) / 2), 1e-15);
  EXPECT_EQ(measured->max, 0.004);
  EXPECT_NEAR(errorOf(rows, RecordedTip::kPredicted, 1.0)->rms, 0.002, 1e-15);
  EXPECT_FALSE(errorOf(rows, RecordedTip::kModel, 1.0)) << "it is unknown";
}

TEST(TipRecord, TheTableHasAColumnForEachValueAndEmptyCellsForTheUnknown) {
  std::vector<TipRow> rows = {rowAt(100.25, -0.5), rowAt(100.5, 0.25)};
  rows[1].model = Eigen::Vector3d(0.5, 0.25, 0);
  rows[1].command = vector({1000, 2000});
  rows[1].pressure = vector({1500, 2500});
  std::ostringstream out;
  writeCsv(rows, 2, out);
  EXPECT_EQ(out.str(),
            "time_s,stamp_s,wanted_x_m,wanted_y_m,wanted_z_m,model_x_m,model_y_m,model_z_m,"
            "predicted_x_m,predicted_y_m,predicted_z_m,measured_x_m,measured_y_m,measured_z_m,"
            "error_m,predicted_sd_m,command_1_pa,command_2_pa,pressure_1_pa,pressure_2_pa,state\n"
            "-0.5,100.25,0,0,0,,,,0,0,0.002,0,0.003,0,0.003,0.0001,,,,,closed\n"
            "0.25,100.5,0,0,0,0.5,0.25,0,0,0,0.002,0,0.003,0,0.003,0.0001,1000,2000,1500,2500,"
            "closed\n");
}

}  // namespace
}  // namespace helix_arm::procedures
