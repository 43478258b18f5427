// Plates and tools: rigid links of an arm.
#include <cmath>

#include <gtest/gtest.h>

#include "helix_arm/model/batch.hpp"
#include "helix_arm/model/curve.hpp"
#include "support/linked_arm.hpp"
#include "support/refusal.hpp"

namespace helix_arm::model {
namespace {

double apart(const lie::SE3& a, const lie::SE3& b) {
  return (a.translation - b.translation).norm() + (a.rotation - b.rotation).norm();
}

// The tip composed by hand.
lie::SE3 composed(const Arm& arm, const Twists& twists) {
  lie::SE3 X;
  for (int k = 0; k < arm.sectionCount(); ++k) {
    lie::Vector6 plate = lie::Vector6::Zero();
    plate[0] = test::kPlates[k];
    X = X * lie::SE3::exp(twists.col(k)) * lie::SE3::exp(plate);
  }
  return X * test::tool();
}

TEST(Links, TheTipIsTheProductOfExponentialsPlatesAndTool) {
  const Arm arm = test::linkedArm();
  test::Random random(71);
  for (int i = 0; i < 200; ++i) {
    const Eigen::VectorXd q = test::randomInput(arm, random);
    const lie::SE3 expected = composed(arm, arm.twists(q));
    EXPECT_LT(apart(arm.tip(q), expected), 1e-13);
    EXPECT_LT(apart(arm.tipOf(arm.twists(q)), expected), 1e-13);
    EXPECT_LT(apart(tipPose(shapeOf(arm, arm.twists(q))), expected), 1e-13);
  }
}

TEST(Links, AnArmWithoutThemHasTheSameBits) {
  const Arm plain = test::ringArm(test::helicalRing(), 2);
  Section section = test::ringSection(test::helicalRing(), test::fig3Muscle());
  section.plate = 0.0;
  const Arm zero({section, section}, lie::SE3());
  EXPECT_EQ(plain.links(), nullptr);
  EXPECT_EQ(zero.links(), nullptr);
  const Eigen::VectorXd q = plain.inputAt(0.3);
  EXPECT_EQ(plain.tip(q).translation, zero.tip(q).translation);
  EXPECT_EQ(plain.tip(q).translation, tipPose(plain.twists(q)).translation);
}

TEST(Links, TheBatchAgreesWithTheTip) {
  const Arm arm = test::linkedArm();
  test::Random random(72);
  constexpr int kCount = 600;
  Eigen::MatrixXd inputs(kCount, arm.actuatorCount());
  for (int row = 0; row < kCount; ++row) inputs.row(row) = test::randomInput(arm, random);
  std::vector<const double*> columns;
  for (int i = 0; i < inputs.cols(); ++i) columns.push_back(inputs.col(i).data());
  Eigen::MatrixX3d tips(kCount, 3);
  batchTips(arm, columns.data(), kCount, tips.col(0).data(), tips.col(1).data(),
            tips.col(2).data());
  for (int row = 0; row < kCount; ++row) {
    const Eigen::VectorXd q = inputs.row(row);
    EXPECT_LT((tips.row(row).transpose() - arm.tip(q).translation).norm(), 1e-14);
  }
}

TEST(Links, SectionsBeginBeyondThePlateAndEndBeforeIt) {
  const Arm arm = test::linkedArm();
  const Shape shape = shapeOf(arm, arm.twists(arm.inputAt(0.4)));
  const lie::SE3 plate{Eigen::Matrix3d::Identity(), {test::kPlates[0], 0, 0}};
  EXPECT_LT(apart(poseAt(shape, 0, 1.0) * plate, poseAt(shape, 1, 0.0)), 1e-14);
  EXPECT_LT(apart(poseAt(shape, 1.0), poseAt(shape, 1, 0.0)), 1e-14);
  EXPECT_LT(apart(poseAt(shape, 1.5), poseAt(shape, 1, 0.5)), 1e-14);
  EXPECT_LT(apart(poseAt(shape, 1, 1.0) * arm.link(1), tipPose(shape)), 1e-13);
  const auto curve = sampleCurve(shape, 5);
  EXPECT_LT(apart(curve[2].X, poseAt(shape, 1, 0.0)), 1e-14);
  EXPECT_LT(apart(curve[4].X, poseAt(shape, 1, 1.0)), 1e-14);
  EXPECT_LT(apart(sampleToTip(shape, 5).back().X, tipPose(shape)), 1e-13);
  EXPECT_LT(apart(tipPose(shape.about(2 * shape.twists())), arm.tipOf(2 * shape.twists())), 1e-13);
}

TEST(Links, ThePlaneAgreesWithSpace) {
  const PlanarArm flat = test::linkedPlanarArm();
  const Arm arm = embed(flat);
  ASSERT_TRUE(arm.links());
  test::Random random(73);
  for (int i = 0; i < 100; ++i) {
    const Eigen::VectorXd q = test::randomInput(arm, random);
    EXPECT_LT(apart(lie::embed(flat.tip(q)), arm.tip(q)), 1e-12);
    EXPECT_LT(apart(lie::embed(flat.tipOf(flat.twists(q))), arm.tip(q)), 1e-12);
  }
}

TEST(Links, StiffnessLeavesThemAsTheyAre) {
  const Arm arm = test::linkedArm();
  const Arm other = arm.scaledStiffness({2, 1, 1.5});
  EXPECT_EQ(other.plate(1), arm.plate(1));
  EXPECT_LT(apart(other.link(1), arm.link(1)), 1e-15);
}

TEST(Links, WhatIsNotRigidIsRefused) {
  Section section = test::ringSection(test::straightRing(), test::fig3Muscle());
  section.plate = -0.01;
  EXPECT_NE(test::refusal<std::invalid_argument>([&] {
              Arm({section});
            }).find("section 1: its plate is -0.01"),
            std::string::npos);
  section.plate = 0;
  lie::SE3 tool;
  tool.translation.x() = NAN;
  EXPECT_NE(test::refusal<std::invalid_argument>([&] {
              Arm({section}, tool);
            }).find("tool is not finite"),
            std::string::npos);
}

}  // namespace
}  // namespace helix_arm::model
