// Tapered sections in every tier.
#include <gtest/gtest.h>

#include "helix_arm/model/curve.hpp"
#include "helix_arm/statics/arm_model.hpp"
#include "helix_arm/statics/correction.hpp"
#include "helix_arm/statics/exact.hpp"
#include "helix_arm/statics/inverse.hpp"
#include "helix_arm/statics/jacobian.hpp"
#include "helix_arm/statics/loaded.hpp"
#include "support/tapered_arm.hpp"

namespace helix_arm::statics {
namespace {

constexpr double kTilt = 15 * test::kPi / 180;

// Two tapered sections of which one changes its slope, and a plate.
model::Arm twoSections() {
  model::Section lower =
      test::taperedSection(test::helicalRing(), {0.05, 0.04, 0.025}, {0.0, kTilt, kTilt});
  lower.plate = 0.01;
  return model::Arm(
      {lower, test::taperedSection(test::helicalRing(), {0.025, 0.02}, {kTilt, 0.0})});
}

double apart(const lie::SE3& a, const lie::SE3& b) {
  return (a.translation - b.translation).norm() + (a.rotation - b.rotation).norm();
}

// Motion of the tip by inputs against differences: velocity and angular velocity, base frame.
void expectJacobian(const ArmModel& model, const Eigen::VectorXd& q, double tolerance) {
  const ShapeJacobian found = jacobianAt(model, q);
  ASSERT_EQ(found.status, SolveStatus::kConverged);
  EXPECT_LT(apart(found.tip, model.tip(q).tip), 1e-9);
  constexpr double kStep = 100;  // [Pa]
  for (int i = 0; i < q.size(); ++i) {
    const Eigen::VectorXd step = kStep * Eigen::VectorXd::Unit(q.size(), i);
    const lie::SE3 below = model.tip(q - step).tip, above = model.tip(q + step).tip;
    const lie::SE3 turn{above.rotation * below.rotation.transpose(), Eigen::Vector3d::Zero()};
    lie::Vector6 expected;
    expected << above.translation - below.translation, turn.log().tail<3>();
    expected /= 2 * kStep;
    EXPECT_LT((found.by_inputs.tip.col(i) - expected).norm(), tolerance * expected.norm()) << i;
  }
}

TEST(TaperedTiers, WithoutLoadTheClosedFormIsTheExactTier) {
  for (const double tilt : {0.0, kTilt}) {
    const model::Arm arm = test::taperedArm(tilt);
    // A load far too small to see: the exact tier integrates all the same.
    Load load = test::weight(test::Posture::kHorizontal, 1e-9, 900);
    const ExactArm exact(arm, load);
    test::Random random(95);
    for (int i = 0; i < 10; ++i) {
      const Eigen::VectorXd q = test::randomInput(arm, random);
      const Solution reference = exact.solve(arm.unloaded(q));
      ASSERT_TRUE(reference.converged());
      EXPECT_LT((arm.tip(q).translation - reference.tip.translation).norm(),
                1e-5 * arm.restLength());
    }
  }
}

TEST(TaperedTiers, UnderLoadEveryOrderMeetsItsStatedErrorAgainstShooting) {
  const model::Arm arms[] = {test::taperedArm(), test::taperedArm(kTilt)};
  for (const model::Arm& arm : arms) {
    const Load load = test::weight(test::Posture::kHorizontal, 0.15, 900);
    const ExactArm exact(arm, load);
    test::Random random(96);
    for (int i = 0; i < 5; ++i) {
      const model::Unloaded unloaded = arm.unloaded(test::randomInput(arm, random));
      const Solution reference = exact.solve(unloaded);
      ASSERT_TRUE(reference.converged());
      EXPECT_GT(
          (reference.tip.translation - model::tipPose(shapeOf(arm, unloaded)).translation).norm(),
          5e-4);
      EXPECT_LT(apart(model::tipPose(reference.shape), reference.tip), 1e-9);
      for (const int order : {2, 3, 5, 8}) {
        const Solution found = LoadedArm(arm, load, order).solve(unloaded);
        ASSERT_TRUE(found.converged());
        const double off = (found.tip.translation - reference.tip.translation).norm();
        EXPECT_LT(off, (order >= 5 ? 1e-5 : statedTipError(order)) * arm.restLength()) << order;
        EXPECT_LT(apart(model::tipPose(found.shape), found.tip), 1e-9);
      }
    }
  }
}

TEST(TaperedTiers, SectionsWithKnotsAndPlatesAgreeWithShooting) {
  const model::Arm arm = twoSections();
  Load load;
  load.gravity = {3, -2, -8};
  load.mass = {0.1, 0.05};
  load.K_eps = {900, 700};
  PointLoad inner;
  inner.section = 0;
  inner.s = 0.7;
  inner.mass = 0.02;
  load.points = {inner};
  test::Random random(97);
  for (int i = 0; i < 5; ++i) {
    const model::Unloaded unloaded = arm.unloaded(test::randomInput(arm, random));
    const Solution reference = ExactArm(arm, load).solve(unloaded);
    const Solution found = LoadedArm(arm, load, 5).solve(unloaded);
    ASSERT_TRUE(reference.converged() && found.converged());
    EXPECT_LT((found.tip.translation - reference.tip.translation).norm(), 1e-4 * arm.restLength());
    // Where a list changes its slope the strain has a kink, and orders gain less.
    const Solution finest = LoadedArm(arm, load, 8).solve(unloaded);
    EXPECT_LT((finest.tip.translation - reference.tip.translation).norm(), 2e-5 * arm.restLength());
    const auto curve = LoadedArm(arm, load, 5).curve(unloaded, 11);
    const auto exact = ExactArm(arm, load).curve(unloaded, 11);
    for (int k = 0; k < 11; ++k) EXPECT_LT(apart(curve[k].X, exact[k].X), 1e-3) << k;
  }
}

TEST(TaperedTiers, ThePlaneAgreesWithSpaceUnderLoad) {
  const model::PlanarArm flat = test::taperedPlanarArm();
  const model::Arm arm = model::embed(flat);
  Load load = test::weight(test::Posture::kHanging, 0.15, 900);
  load.gravity = {2, -9, 0};
  test::Random random(98);
  for (int i = 0; i < 10; ++i) {
    const Eigen::VectorXd q = test::randomInput(arm, random);
    const Solution plane = PlanarLoadedArm(flat, load, 5).solve(flat.unloaded(q));
    const Solution space = LoadedArm(arm, load, 5).solve(arm.unloaded(q));
    ASSERT_TRUE(plane.converged() && space.converged());
    EXPECT_LT(apart(plane.tip, space.tip), 1e-8);
  }
}

TEST(TaperedTiers, TwistsAloneAreRefused) {
  const model::Arm arm = test::taperedArm();
  const Load load = test::weight(test::Posture::kHorizontal, 0.1, 900);
  const model::Twists twists = arm.twists(arm.inputAt(0.5));
  EXPECT_THROW(LoadedArm(arm, load, 5).solve(twists), std::invalid_argument);
  EXPECT_THROW(ExactArm(arm, load).solve(twists), std::invalid_argument);
  EXPECT_THROW(InverseSolver{arm}, std::invalid_argument);
  EXPECT_THROW(CorrectedModel(arm, nullptr), std::invalid_argument);
}

TEST(TaperedTiers, JacobiansAgreeWithDifferences) {
  const model::Arm arm = twoSections();
  Load load;
  load.gravity = {3, -2, -8};
  load.mass = {0.1, 0.05};
  load.K_eps = {900, 900};
  const Eigen::VectorXd lengths = arm.lengths(arm.inputAt(0.4));
  constexpr double kStep = 1e-5;
  const ArmModel models[] = {ArmModel(arm),
                             ArmModel(arm, std::nullopt, load, TierSetting{Tier::kLoaded, 5})};
  for (const ArmModel& model : models) {
    EXPECT_FALSE(model.isLinear());
    const TipResponse response = model.tipResponse(lengths);
    for (int i = 0; i < lengths.size(); ++i) {
      const Eigen::VectorXd step = kStep * Eigen::VectorXd::Unit(lengths.size(), i);
      const lie::Vector6 expected = (model.tipOfLengths(lengths - step).tip.inverse() *
                                     model.tipOfLengths(lengths + step).tip)
                                        .log() /
                                    (2 * kStep);
      EXPECT_LT((response.by_lengths.col(i) - expected).norm(), 1e-5 * expected.norm()) << i;
    }
  }
}

TEST(TaperedTiers, TheInverseCloses) {
  const ArmModel model(test::taperedArm(kTilt));
  InverseSolver solver(model);
  test::Random random(99);
  for (int i = 0; i < 10; ++i) {
    const Eigen::Vector3d target =
        model.tip(test::randomInput(model.arm(), random)).tip.translation;
    const InverseResult& found = solver.toPosition(target, model.arm().inputAt(0.5));
    EXPECT_EQ(found.status, InverseStatus::kReached);
    EXPECT_LT((model.tip(found.input).tip.translation - target).norm(), 1e-5);
  }
  const Eigen::VectorXd q = model.arm().inputAt(Eigen::VectorXd(Eigen::Vector3d(0.7, 0.2, 0.4)));
  const InverseResult& twists =
      solver.toTwists(model.solve(q).shape.twists(), model.arm().inputAt(0.5));
  EXPECT_EQ(twists.status, InverseStatus::kReached);
}

TEST(TaperedTiers, ACorrectionMovesTheMeanTwists) {
  const ArmModel model(test::taperedArm());
  CorrectedModel corrected(model);
  Correction correction(model.arm());
  correction.offset(4, 0) = 0.1;
  corrected.set(correction);
  const Eigen::VectorXd q = model.arm().inputAt(0.3);
  const auto shape = corrected.shape(model.arm().lengths(q));
  ASSERT_TRUE(shape);
  EXPECT_GT(shape->piecesPerSection(), 1);
  EXPECT_NEAR(shape->twists()(4, 0), model.solve(q).shape.twists()(4, 0) + 0.1, 1e-12);
}

TEST(TaperedTiers, DerivativesByInput) {
  const ArmModel plain(test::taperedArm(kTilt));
  expectJacobian(plain, plain.arm().inputAt(0.4), 1e-5);
  EXPECT_FALSE(jacobianAt(plain, plain.arm().inputAt(0.4)).by_load);
  const ArmModel loaded(test::taperedArm(), std::nullopt,
                        test::weight(test::Posture::kHorizontal, 0.1, 900),
                        TierSetting{Tier::kLoaded, 6});
  expectJacobian(loaded, loaded.arm().inputAt(0.4), 1e-5);
  EXPECT_TRUE(jacobianAt(loaded, loaded.arm().inputAt(0.4)).by_load);
}

}  // namespace
}  // namespace helix_arm::statics
