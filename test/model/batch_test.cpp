#include "helix_arm/model/batch.hpp"

#include <cstdio>
#include <vector>

#include <gtest/gtest.h>

#include "support/paper_arm.hpp"

namespace helix_arm::model {
namespace {

constexpr double kEps = 2.220446049250313e-16;

// Worst distance of the batch's tips from the single call's, in eps of the arm's rest length.
double worstDifference(const Arm& arm, std::size_t count, unsigned seed) {
  test::Random random(seed);
  std::vector<std::vector<double>> q(arm.actuatorCount(), std::vector<double>(count));
  std::vector<const double*> inputs;
  for (int i = 0; i < arm.actuatorCount(); ++i) {
    for (double& value : q[i])
      value = random.uniform(arm.actuator(i).limits.lower, arm.actuator(i).limits.upper);
    inputs.push_back(q[i].data());
  }
  std::vector<double> x(count + 1, -7), y(count + 1, -7), z(count + 1, -7);
  batchTips(arm, inputs.data(), count, x.data(), y.data(), z.data());
  EXPECT_EQ(x[count], -7) << "wrote past the end";
  double length = 0;
  for (int k = 0; k < arm.sectionCount(); ++k) length += arm.restTwist(k).head<3>().norm();
  double worst = 0;
  Eigen::VectorXd one(arm.actuatorCount());
  for (std::size_t j = 0; j < count; ++j) {
    for (int i = 0; i < one.size(); ++i) one[i] = q[i][j];
    worst = std::max(worst, (arm.tip(one).translation - Eigen::Vector3d(x[j], y[j], z[j])).norm());
  }
  return worst / (kEps * length);
}

TEST(Batch, AgreesWithTheSingleCallTo8Eps) {
  std::printf("instruction set: %s\n", batchInstructionSet());
  for (const auto& ring : {test::straightRing(), test::helicalRing()}) {
    const double worst = worstDifference(test::ringArm(ring), 200000, 71);
    std::printf("batch against single call: %.2f eps of the length\n", worst);
    EXPECT_LE(worst, 8.0);
  }
}

TEST(Batch, HandlesEveryCountAroundItsBlocks) {
  const Arm arm = test::ringArm(test::straightRing());
  for (const std::size_t count : {0, 1, 7, 8, 9, 127, 128, 129, 255, 256, 257, 1000}) {
    EXPECT_LE(worstDifference(arm, count, 72), 8.0) << count;
  }
}

TEST(Batch, HandlesEveryNumberOfActuatorsAndSections) {
  for (const int actuators : {1, 2, 3, 4, 5, 6, 7, 24}) {
    for (const int sections : {1, 2, 4}) {
      const Arm arm = test::ringArm(test::straightRing(actuators), sections);
      EXPECT_LE(worstDifference(arm, 500, 73), 8.0)
          << actuators << " actuators, " << sections << " sections";
    }
  }
}

TEST(Batch, HandlesAnglesBeyondTheSeries) {
  // A thin arm: all angles in one block, some within the series and some beyond.
  test::Ring ring = test::straightRing();
  ring.radius = 0.008;
  ring.stiffness.kappa = 1e-6;
  const Arm arm = test::ringArm(ring);
  test::Random random(74);
  int near = 0, far = 0;
  for (int i = 0; i < 1000; ++i) {
    arm.twists(test::randomInput(arm, random)).bottomRows(3).squaredNorm() > 20 ? ++far : ++near;
  }
  ASSERT_GT(near, 50);
  ASSERT_GT(far, 50);
  EXPECT_LE(worstDifference(arm, 20000, 75),
            24.0);  // three times the bending, three times the rounding
}

TEST(Batch, HandlesTablesAndTendons) {
  Section section = test::ringSection(test::straightRing(), test::fig3Muscle());
  const Contraction table = Contraction::table({0, 1e5, 2e5, 4e5}, {0.43, 0.41, 0.36, 0.34});
  section.actuators[0].contraction = table;
  section.actuators[0].limits = table.inputRange();
  section.actuators[1].contraction = Contraction::tendon(0.43, 0.01, 8);
  section.actuators[1].limits = {0, 8};
  EXPECT_LE(worstDifference(Arm({section}), 5000, 76), 8.0);
}

}  // namespace
}  // namespace helix_arm::model
