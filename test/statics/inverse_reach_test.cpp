// Targets that can be reached are reached, all of them.
#include <cmath>
#include <cstdio>

#include <gtest/gtest.h>

#include "helix_arm/statics/inverse.hpp"
#include "support/paper_arm.hpp"

namespace helix_arm::statics {
namespace {

using model::Twists;

void expectWithinLimits(const model::Arm& arm, const Eigen::VectorXd& q) {
  for (int i = 0; i < q.size(); ++i) ASSERT_TRUE(arm.actuator(i).limits.contains(q[i])) << q[i];
}

// Failures among `count` tips of random inputs, each from the middle of the limits.
int failuresToPosition(const model::Arm& arm, int count, unsigned seed,
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
    const model::Arm arm = test::ringArm(ring);
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

// Thin soft arms bend to more than a circle: the tip comes back to the base, where turning the
// circle hardly moves it, and a start in another direction has no way on.
TEST(Inverse, ReachesTipsOfArmsThatCurlToTheirOwnBase) {
  struct Curl {
    test::Ring ring;
    int sections, count;
  };
  const test::Ring soft{3, 0.006, 0.0, {10.0, 0.0, 1e-6}}, thin{3, 0.0075, 0.0, {10.0, 0.0, 5e-6}};
  test::Ring four = thin, six = thin;
  four.count = 4;
  six.count = 6;
  test::Random random(99);
  for (const Curl& curl :
       {Curl{soft, 1, 3000}, {thin, 1, 3000}, {four, 1, 3000}, {six, 1, 500}, {thin, 2, 500}}) {
    const model::Arm arm = test::ringArm(curl.ring, curl.sections);
    EXPECT_EQ(failuresToPosition(arm, curl.count, 99), 0);
    // Again with the last section within 0.2 rad of a whole turn.
    InverseSolver solver(arm);
    int failures = 0, compared = 0;
    while (compared < curl.count) {
      const Eigen::VectorXd q = test::randomInput(arm, random);
      const double turn = arm.twists(q).col(curl.sections - 1).tail<3>().norm();
      if (std::abs(turn - 2 * test::kPi) > 0.2) continue;
      ++compared;
      const Eigen::Vector3d target = arm.tip(q).translation;
      const InverseResult& result = solver.toPosition(target, arm.inputAt(0.5));
      const bool reached = result.status == InverseStatus::kReached &&
                           (arm.tip(result.input).translation - target).norm() <= 1e-6;
      if (!reached) ++failures;
    }
    EXPECT_EQ(failures, 0) << curl.ring.count << " actuators, " << curl.sections << " sections";
  }
}

TEST(Inverse, ReachesPosesAndTwists) {
  for (const int sections : {1, 2}) {
    for (const auto& ring : {test::straightRing(), test::helicalRing(), test::helicalRing(4)}) {
      const model::Arm arm = test::ringArm(ring, sections);
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
        const model::Twists g = arm.twists(q);
        const InverseResult& twists = solver.toTwists(g, arm.inputAt(0.5));
        EXPECT_EQ(twists.status, InverseStatus::kReached);
        EXPECT_LT((arm.twists(twists.input) - g).norm(), 2e-5);
      }
      EXPECT_EQ(pose_failures, 0) << sections << " sections of " << ring.count;
    }
  }
}

}  // namespace
}  // namespace helix_arm::statics
