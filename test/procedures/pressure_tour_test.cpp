#include <cmath>
#include <stdexcept>

#include <gtest/gtest.h>

#include "helix_arm/model/curve.hpp"
#include "helix_arm/procedures/pressure_plan.hpp"
#include "support/sample_arm.hpp"

namespace helix_arm::procedures {
namespace {

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

TEST(PressureTour, AnUnusableShareIsRefused) {
  const model::Arm arm = test::sampleArm();
  for (const double fraction : {0.0, -0.1, 1.1, std::nan("")}) {
    EXPECT_THROW(pressureTour(arm, fraction), std::invalid_argument) << fraction;
  }
}

}  // namespace
}  // namespace helix_arm::procedures
