#include "helix_arm/procedures/pressure_plan.hpp"

#include <cmath>

#include <gtest/gtest.h>

#include "helix_arm/model/curve.hpp"
#include "support/has.hpp"
#include "support/sample_arm.hpp"

namespace helix_arm::procedures {
namespace {

const model::Arm kArm = test::sampleArm(1, 3);

TEST(PressurePlan, OfThePaperGoesUpTo60PsiOnOneMuscleAfterTheOther) {
  const double psi[] = {0, 10, 15, 20, 25, 30, 35, 40, 45, 50, 55, 60};
  const Eigen::MatrixXd plan = defaultPressurePlan(kArm);
  ASSERT_EQ(plan.rows(), 12);
  ASSERT_EQ(plan.cols(), 3);
  for (int step = 0; step < 12; ++step) {
    for (int i = 0; i < 3; ++i) {
      const double expected = i == step % 3 ? test::kSampleMaxPressure * psi[step] / 60 : 0.0;
      EXPECT_NEAR(plan(step, i), expected, 1e-6) << step << " " << i;
    }
  }
}

TEST(PressurePlan, WithoutRowsIsTheDefaultOne) {
  EXPECT_EQ(std::get<Eigen::MatrixXd>(checkPlan(kArm, {})), defaultPressurePlan(kArm));
}

TEST(PressurePlan, IsReadRowByRow) {
  const auto plan = std::get<Eigen::MatrixXd>(checkPlan(kArm, {0, 1, 2, 3, 4, 5}));
  ASSERT_EQ(plan.rows(), 2);
  EXPECT_EQ(plan(0, 2), 2);
  EXPECT_EQ(plan(1, 0), 3);
}

TEST(PressurePlan, ThereAndBackReachesEveryPressureFromBelowAndFromAbove) {
  const Eigen::MatrixXd loop = std::get<Eigen::MatrixXd>(checkPlan(kArm, {}, true));
  ASSERT_EQ(loop.rows(), 23);
  EXPECT_EQ(loop, loop.colwise().reverse());
  const Eigen::MatrixXd plan = defaultPressurePlan(kArm);
  for (Eigen::Index k = 0; k < plan.rows(); ++k) {
    const Eigen::RowVectorXd level = plan.row(k);
    Eigen::Index actuator = 0;
    const double pressure = level.maxCoeff(&actuator);
    if (pressure == 0) continue;
    int from_below = 0, from_above = 0;
    for (Eigen::Index step = 1; step < loop.rows(); ++step) {
      if (loop.row(step) != level) continue;
      from_below += loop(step - 1, actuator) < pressure;
      from_above += loop(step - 1, actuator) > pressure;
    }
    EXPECT_GE(from_below, 1) << level;
    // The largest of each actuator has nothing above it.
    const bool largest = plan.col(actuator).maxCoeff() == pressure;
    EXPECT_EQ(from_above, largest ? 0 : 1) << level;
  }
}

TEST(PressurePlan, OfRowsGoesThereAndBackInTheirOrder) {
  const auto plan = std::get<Eigen::MatrixXd>(checkPlan(kArm, {0, 1, 2, 3, 4, 5, 6, 7, 8}, true));
  ASSERT_EQ(plan.rows(), 5);
  EXPECT_EQ(plan.col(0), (Eigen::VectorXd(5) << 0, 3, 6, 3, 0).finished());
}

TEST(PressurePlan, ThatTheArmCannotFollowIsRefusedWithTheReason) {
  const auto faultOf = [](const std::vector<double>& rows) {
    return std::get<control::Refusal>(checkPlan(kArm, rows));
  };
  EXPECT_EQ(faultOf({0, 1, 2, 3}).fault, control::Fault::kWrongSize);
  EXPECT_EQ(faultOf({0, 1, std::nan(""), 3, 4, 5}).fault, control::Fault::kNotFinite);
  const control::Refusal beyond = faultOf({0, 0, 0, 0, 5e5, 0});
  EXPECT_EQ(beyond.fault, control::Fault::kOutOfRange);
  EXPECT_TRUE(test::has(beyond.message, "step 2 of the plan: s1_m2"));
  EXPECT_EQ(faultOf({1, 2, 3, 1, 2, 3}).fault, control::Fault::kOutOfRange);
  EXPECT_EQ(faultOf({1, 2, 3}).fault, control::Fault::kOutOfRange);
}

TEST(PressureTour, StaysWithinItsShareOfTheLimits) {
  for (const int sections : {1, 3}) {
    for (const int count : {1, 2, 3, 5}) {
      const model::Arm arm = test::sampleArm(sections, count);
      const Eigen::MatrixXd tour = pressureTour(arm, 0.5);
      ASSERT_EQ(tour.cols(), arm.actuatorCount());
      EXPECT_GE(tour.minCoeff(), 0.0);
      EXPECT_LE(tour.maxCoeff(), 0.5 * test::kSampleMaxPressure * (1 + 1e-12));
    }
  }
}

TEST(PressureTour, BeginsAndEndsAtRest) {
  const Eigen::MatrixXd tour = pressureTour(test::sampleArm());
  EXPECT_EQ(tour.row(0).cwiseAbs().maxCoeff(), 0.0);
  EXPECT_EQ(tour.bottomRows(1).cwiseAbs().maxCoeff(), 0.0);
}

TEST(PressureTour, BendsAThreeMuscleArmIntoEveryQuadrant) {
  const model::Arm arm = test::sampleArm();
  const Eigen::MatrixXd tour = pressureTour(arm);
  bool seen[2][2] = {};
  for (int row = 0; row < tour.rows(); ++row) {
    const Eigen::Vector3d tip = arm.tip(tour.row(row).transpose()).translation;
    if (tip.tail<2>().norm() > 0.05) seen[tip.y() > 0][tip.z() > 0] = true;
  }
  EXPECT_TRUE(seen[0][0] && seen[0][1] && seen[1][0] && seen[1][1]);
}

TEST(PressureTour, NeighbouringSectionsLeadWithDifferentMuscles) {
  const Eigen::MatrixXd tour = pressureTour(test::sampleArm(2, 2));
  Eigen::Index first, second;
  tour.row(1).head(2).maxCoeff(&first);
  tour.row(1).tail(2).maxCoeff(&second);
  EXPECT_NE(first, second);
}

}  // namespace
}  // namespace helix_arm::procedures
