// Targets that can be reached are reached, all of them.
#include <cstdio>

#include <gtest/gtest.h>

#include "helix_arm/model/inverse.hpp"
#include "support/paper_arm.hpp"

namespace helix_arm::model {
namespace {

void expectWithinLimits(const Arm& arm, const Eigen::VectorXd& q) {
  for (int i = 0; i < q.size(); ++i) ASSERT_TRUE(arm.actuator(i).limits.contains(q[i])) << q[i];
}

// Failures among `count` tips of random inputs, each from the middle of the limits.
int failuresToPosition(const Arm& arm, int count, unsigned seed,
                       const InverseOptions& options = {}) {
  InverseSolver solver(arm, options);
  const Eigen::VectorXd start = arm.inputAt(0.5);
  test::Random random(seed);
  int failures = 0;
  long iterations = 0;
  for (int i = 0; i < count; ++i) {
    const Eigen::Vector3d target = arm.tip(test::randomInput(arm, random)).translation;
    const InverseResult& result = solver.toPosition(target, start);
    expectWithinLimits(arm, result.input);
    const double error = (arm.tip(result.input).translation - target).norm();
    EXPECT_NEAR(error, result.position_error, 1e-12);
    if (!(error <= options.position_tolerance) || result.status != InverseStatus::kReached)
      ++failures;
    iterations += result.iterations;
  }
  std::printf("%d targets, %d actuators: %d failures, %.2f iterations\n", count,
              arm.actuatorCount(), failures, static_cast<double>(iterations) / count);
  return failures;
}

TEST(Inverse, ReachesAMillionRandomTips) {
  EXPECT_EQ(failuresToPosition(test::ringArm(test::straightRing()), 500000, 91), 0);
  EXPECT_EQ(failuresToPosition(test::ringArm(test::helicalRing()), 500000, 92), 0);
}

TEST(Inverse, ReachesTipsOfManyKindsOfArm) {
  for (const int count : {2, 4, 6, 8}) {
    EXPECT_EQ(failuresToPosition(test::ringArm(test::straightRing(count)), 2000, 93), 0);
    EXPECT_EQ(failuresToPosition(test::ringArm(test::helicalRing(count)), 2000, 94), 0);
  }
  for (const int sections : {2, 3}) {
    EXPECT_EQ(failuresToPosition(test::ringArm(test::straightRing(), sections), 2000, 95), 0);
    EXPECT_EQ(failuresToPosition(test::ringArm(test::helicalRing(), sections), 2000, 96), 0);
  }
}

TEST(Inverse, ReachesTipsAtTheLimits) {
  // Every input at a limit of its own: the corners and edges of what the arm can do.
  for (const auto& ring : {test::straightRing(), test::helicalRing()}) {
    const Arm arm = test::ringArm(ring);
    InverseSolver solver(arm);
    test::Random random(97);
    for (int i = 0; i < 5000; ++i) {
      Eigen::VectorXd q = test::randomInput(arm, random);
      for (int k = 0; k < 3; ++k) {
        const int side = random.integer(0, 2);
        if (side < 2) q[k] = side == 0 ? 0 : test::kMaxPressure;
      }
      const InverseResult& result = solver.toPosition(arm.tip(q).translation, arm.inputAt(0.5));
      EXPECT_EQ(result.status, InverseStatus::kReached) << q.transpose();
    }
  }
}

TEST(Inverse, ReachesPosesAndTwists) {
  for (const int sections : {1, 2}) {
    for (const auto& ring : {test::straightRing(), test::helicalRing(), test::helicalRing(4)}) {
      const Arm arm = test::ringArm(ring, sections);
      InverseSolver solver(arm);
      test::Random random(98);
      int pose_failures = 0;
      for (int i = 0; i < 3000; ++i) {
        const Eigen::VectorXd q = test::randomInput(arm, random);
        const lie::SE3 tip = arm.tip(q);
        const InverseResult& pose = solver.toPose(tip, arm.inputAt(0.5));
        const lie::SE3 reached = arm.tip(pose.input);
        if (pose.status != InverseStatus::kReached ||
            (reached.translation - tip.translation).norm() > 1e-6 ||
            (reached.rotation - tip.rotation).norm() > 3e-5) {
          ++pose_failures;
        }
        const Twists g = arm.twists(q);
        const InverseResult& twists = solver.toTwists(g, arm.inputAt(0.5));
        EXPECT_EQ(twists.status, InverseStatus::kReached);
        EXPECT_LT((arm.twists(twists.input) - g).norm(), 2e-5);
      }
      EXPECT_EQ(pose_failures, 0) << sections << " sections of " << ring.count;
    }
  }
}

}  // namespace
}  // namespace helix_arm::model
