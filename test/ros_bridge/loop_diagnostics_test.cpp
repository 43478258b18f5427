#include <gtest/gtest.h>

#include "ros_bridge/follow/loop_reports.hpp"
#include "support/paper_arm.hpp"

namespace helix_arm::ros_bridge {
namespace {

using estimation::ObservationFault;

struct Stamped {
  ObservationFault fault;
  double lead;        // over the last reading [s]
  const char* words;  // what is told; empty if the stamp is not to blame
};

TEST(LoopDiagnostics, AWrongStampIsNamedUntilTheNextPicture) {
  const estimation::ArmFilter filter(statics::ArmModel(test::ringArm(test::helicalRing())), {});
  LoopDiagnostics pictures;
  EXPECT_EQ(pictures.wrongStamp(), "");
  const Stamped stamps[] = {
      {ObservationFault::kFuture, 1.004, "stamped 1.00 s after the last reading"},
      {ObservationFault::kNone, -0.05, ""},
      {ObservationFault::kTooOld, -1.06, "stamped 1.06 s before the last reading"},
      {ObservationFault::kOutlier, -0.05, ""},
      // The clock of the pressures is the one that is behind.
      {ObservationFault::kTooOld, 0.94, "stamped 0.94 s after the last reading"},
      {ObservationFault::kNotNewer, -0.5, ""},
  };
  for (const Stamped& stamp : stamps) {
    pictures.saw(100.0, stamp.lead, {stamp.fault, 0.0}, filter, true);
    const std::string& told = pictures.wrongStamp();
    EXPECT_NE(told.find(stamp.words), std::string::npos) << told;
    EXPECT_EQ(told.empty(), *stamp.words == '\0') << told;
    if (told.empty()) continue;
    EXPECT_NE(told.find(estimation::nameOf(stamp.fault)), std::string::npos) << told;
    EXPECT_NE(told.find("synchronise the clocks"), std::string::npos) << told;
  }
  EXPECT_EQ(pictures.accepted(), 1U);
  EXPECT_EQ(pictures.refused(), 5U);
}

class CalibrationWatchTest : public ::testing::Test {
 protected:
  // The length of muscle_2 is off by so many prior deviations, and known to so much of one.
  const std::string& note(double time, double sigmas, double known) {
    const Eigen::Vector2d prior(0.3, 0.002);
    const Eigen::VectorXd value = Eigen::Vector2d(0, 0.002 * sigmas);
    const Eigen::VectorXd deviation = Eigen::Vector2d(0.05, 0.002 * known);
    watch_.note(time, {{"K_gamma", "length of muscle_2"}, value, deviation, prior});
    return watch_.advice();
  }
  CalibrationWatch watch_;
};

TEST_F(CalibrationWatchTest, WhatLiesBeyondThreeSigmasForAMinuteIsToBeCalibratedAgain) {
  EXPECT_EQ(note(10, 4, 0.1), "");
  EXPECT_EQ(note(69.9, 4, 0.1), "");
  EXPECT_EQ(note(70.1, 4, 0.1), "length of muscle_2 +0.8 %");
  EXPECT_EQ(note(70.2, -4, 0.1), "length of muscle_2 -0.8 %");
  EXPECT_EQ(note(70.3, 2.99, 0.1), "");
}

TEST_F(CalibrationWatchTest, AMomentWithinThemStartsTheMinuteAnew) {
  note(10, 3.01, 0.1);
  note(40, 2.99, 0.1);
  note(41, 3.01, 0.1);
  EXPECT_EQ(note(71, 3.01, 0.1), "");
  EXPECT_NE(note(101.1, 3.01, 0.1), "");
}

TEST_F(CalibrationWatchTest, AnUncertainDeviationIsNoReason) {
  for (const double time : {0.0, 70.0}) EXPECT_EQ(note(time, 4, 0.34), "") << time;
  for (const double time : {100.0, 170.0}) note(time, 4, 0.33);
  EXPECT_NE(watch_.advice(), "");
}

TEST_F(CalibrationWatchTest, AJumpBackInTimeStartsTheMinuteAnew) {
  note(1000, 4, 0.1);
  EXPECT_EQ(note(10, 4, 0.1), "");
  EXPECT_EQ(note(69, 4, 0.1), "");
  EXPECT_NE(note(71, 4, 0.1), "");
}

}  // namespace
}  // namespace helix_arm::ros_bridge
