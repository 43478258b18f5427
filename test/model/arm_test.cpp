#include "helix_arm/model/arm.hpp"

#include <stdexcept>

#include <gtest/gtest.h>

#include "helix_arm/model/curve.hpp"
#include "support/allocation_counter.hpp"
#include "support/paper_arm.hpp"
#include "support/refusal.hpp"

namespace helix_arm::model {
namespace {

TEST(Arm, TwistIsTheMapTimesTheLengths) {
  const Arm arm = test::ringArm(test::helicalRing());
  test::Random random(61);
  for (int i = 0; i < 1000; ++i) {
    const Eigen::VectorXd q = test::randomInput(arm, random);
    const lie::Vector6 expected = arm.equilibrium(0).map * arm.lengths(q);
    EXPECT_LT((arm.twists(q).col(0) - expected).norm(), 1e-13);
    EXPECT_LT((arm.twistsOfLengths(arm.lengths(q)).col(0) - expected).norm(), 1e-13);
  }
}

TEST(Arm, SectionsInSeriesAreTheProductOfTheirExponentials) {
  const Arm arm = test::ringArm(test::helicalRing(), 3);
  test::Random random(62);
  for (int i = 0; i < 200; ++i) {
    const Eigen::VectorXd q = test::randomInput(arm, random);
    lie::SE3 expected;
    for (int k = 0; k < 3; ++k) {
      expected =
          expected * lie::SE3::exp(arm.equilibrium(k).map * arm.lengths(q).segment<3>(3 * k));
    }
    const lie::SE3 tip = arm.tip(q);
    EXPECT_LT((tip.translation - expected.translation).norm(), 1e-13);
    EXPECT_LT((tip.rotation - expected.rotation).norm(), 1e-13);
    EXPECT_LT((tipPose(arm.twists(q)).translation - tip.translation).norm(), 1e-14);
  }
}

TEST(Arm, InflatingOneMuscleBendsTowardsIt) {
  const Arm arm = test::ringArm(test::straightRing());
  const Eigen::Vector3d tip = arm.tip(Eigen::Vector3d(3e5, 0, 0)).translation;
  EXPECT_GT(tip.y(), 0.05);  // muscle 1 sits at +y
  EXPECT_NEAR(tip.z(), 0.0, 1e-12);
}

TEST(Arm, EqualPressuresKeepAStraightArmStraight) {
  const Arm arm = test::ringArm(test::straightRing(4));
  const lie::SE3 tip = arm.tip(Eigen::Vector4d::Constant(2e5));
  EXPECT_LT(tip.translation.tail<2>().norm(), 1e-14);
  EXPECT_NEAR(tip.translation.x(), test::fig3Muscle().length(2e5), 1e-14);
}

TEST(Arm, ActuatorsMayDiffer) {
  // A tendon and a muscle in one section: each keeps its own length, stiffness and limits.
  Section section = test::ringSection(test::straightRing(), test::fig3Muscle());
  section.actuators[1].contraction = Contraction::tendon(0.42, 0.01, 5);
  section.actuators[1].limits = {0, 4};
  section.actuators[1].drive = Drive::kTendon;
  section.actuators[1].stiffness.kappa = 1e-3;
  const Arm arm({section});
  const Eigen::VectorXd l = arm.lengths(Eigen::Vector3d(1e5, 2, 0));
  EXPECT_NEAR(l[1], 0.40, 1e-15);
  EXPECT_NE(test::refusal<std::out_of_range>([&] {
              arm.tip(Eigen::Vector3d(1e5, 4.5, 0));
            }).find("muscle_2 is asked for 4.5"),
            std::string::npos);
}

TEST(Arm, RefusesInputsThatBreakTheContract) {
  const Arm arm = test::ringArm(test::straightRing());
  EXPECT_NE(test::refusal<std::invalid_argument>([&] {
              arm.tip(Eigen::Vector2d::Zero());
            }).find("got 2 inputs"),
            std::string::npos);
  for (const double bad : {-1.0, 1e6, double(NAN), double(INFINITY)}) {
    const Eigen::Vector3d q(0, bad, 0);
    EXPECT_NE(test::refusal<std::out_of_range>([&] { arm.tip(q); }).find("muscle_2"),
              std::string::npos)
        << bad;
    EXPECT_THROW(arm.twists(q), std::out_of_range);
    EXPECT_THROW(arm.lengths(q), std::out_of_range);
  }
}

TEST(Arm, ClampsInputsToTheirLimits) {
  const model::Arm arm = test::ringArm(test::straightRing());
  EXPECT_EQ(arm.clamped(Eigen::Vector3d(-1e3, 2e5, 2 * test::kMaxPressure)),
            Eigen::Vector3d(0, 2e5, test::kMaxPressure));
  EXPECT_THROW(arm.clamped(Eigen::VectorXd::Zero(2)), std::invalid_argument);
}

TEST(Arm, RefusesToBeBuiltWrong) {
  EXPECT_NE(test::refusal<std::invalid_argument>([] { Arm({}); }).find("0 sections"),
            std::string::npos);
  EXPECT_NE(test::refusal<std::invalid_argument>([] {
              test::ringArm(test::straightRing(), 17);
            }).find("17 sections"),
            std::string::npos);
  EXPECT_NE(test::refusal<std::invalid_argument>([] { Arm({Section{}}); }).find("section 1"),
            std::string::npos);
  Section section = test::ringSection(test::straightRing(), test::fig3Muscle());
  section.actuators[2].limits.upper = 1e6;
  EXPECT_NE(
      test::refusal<std::invalid_argument>([&] { Arm({section}); }).find("muscle_3 has limits"),
      std::string::npos);
  section = test::ringSection(test::straightRing(), test::fig3Muscle());
  section.actuators[1].stiffness.tau = -1;
  EXPECT_NE(
      test::refusal<std::invalid_argument>([&] { Arm({section}); }).find("muscle_2 has K_tau"),
      std::string::npos);
}

TEST(PlanarArm, AgreesWithItsEmbedding) {
  const Contraction muscle = test::fig3Muscle();
  PlanarSection section;
  for (const double y : {0.0381, -0.0381}) {
    section.actuators.push_back({"muscle",
                                 {Eigen::Matrix2d::Identity(), {0, y}},
                                 {10, 0, 1.38e-4},
                                 muscle,
                                 muscle.inputRange()});
  }
  const PlanarArm flat({section, section});
  const Arm arm = embed(flat);
  test::Random random(63);
  for (int i = 0; i < 200; ++i) {
    const Eigen::VectorXd q = test::randomInput(arm, random);
    EXPECT_LT((lie::embed(flat.tip(q)).translation - arm.tip(q).translation).norm(), 1e-13);
    EXPECT_LT((embed(flat.twists(q)) - arm.twists(q)).norm(), 1e-12);
  }
}

TEST(Arm, PressuresToTipDoesNotAllocate) {
  const Arm arm = test::ringArm(test::helicalRing(), 2);
  const Eigen::VectorXd q = Eigen::VectorXd::Constant(6, 1e5);
  const test::AllocationCounter counter;
  const double sum = arm.tip(q).translation.sum() + arm.twists(q).sum();
  EXPECT_EQ(counter.count(), 0u);
  EXPECT_TRUE(std::isfinite(sum));
}

}  // namespace
}  // namespace helix_arm::model
