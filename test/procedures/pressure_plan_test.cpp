#include "helix_arm/procedures/pressure_plan.hpp"

#include <cmath>

#include <gtest/gtest.h>

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
  EXPECT_NE(beyond.message.find("step 2 of the plan: s1_m2"), std::string::npos) << beyond.message;
  EXPECT_EQ(faultOf({1, 2, 3, 1, 2, 3}).fault, control::Fault::kOutOfRange);
  EXPECT_EQ(faultOf({1, 2, 3}).fault, control::Fault::kOutOfRange);
}

}  // namespace
}  // namespace helix_arm::procedures
