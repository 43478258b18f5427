// Tapered sections in every tier.
#include <gtest/gtest.h>

#include "helix_arm/model/curve.hpp"
#include "helix_arm/statics/correction.hpp"
#include "helix_arm/statics/exact.hpp"
#include "helix_arm/statics/inverse.hpp"
#include "helix_arm/statics/loaded.hpp"
#include "statics/arms_under_load.hpp"

namespace helix_arm::statics {
namespace {

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

// Plates and tools in every tier, with and without load.

// A plate is a section that is too stiff to bend: a third section of that length, without muscles'
// motion, in the place of the plate.
TEST(LoadedLinks, APlateIsAPieceThatDoesNotBend) {
  constexpr double kPlate = 0.05;
  model::Section soft = test::ringSection(test::helicalRing(), test::fig3Muscle());
  model::Section stiff =
      test::ringSection(test::straightRing(), model::Contraction::tendon(kPlate, 1e-9, 1.0));
  for (model::Actuator& actuator : stiff.actuators) actuator.stiffness.tau = 1e-3;
  model::Section plated = soft;
  plated.plate = kPlate;
  const model::Arm with({plated, soft}), instead({soft, stiff, soft});
  Load load = test::evenLoad(2, {3, -2, -8}, 0.1, 900);
  load.mass[1] = 0.08;
  load.points = {{1, 1.0, 0.03}};
  Load longer = load;
  longer.mass = {0.1, 0.0, 0.08};
  longer.K_eps = {900, 1e9, 900};
  longer.points[0].section = 2;
  test::Random random(82);
  for (int i = 0; i < 5; ++i) {
    const Eigen::VectorXd q = test::randomInput(with, random);
    Eigen::VectorXd more(9);
    more << q.head<3>(), Eigen::Vector3d::Zero(), q.tail<3>();
    const Solution a = ExactArm(with, load).solve(with.twists(q));
    const Solution b = ExactArm(instead, longer).solve(instead.twists(more));
    ASSERT_TRUE(a.converged() && b.converged());
    EXPECT_LT(apart(a.tip, b.tip), 2e-6);
  }
}

TEST(LoadedLinks, AForceAtTheToolIsItsWrenchAtTheEndOfTheCurve) {
  const model::Arm bare = test::ringArm(test::helicalRing(), 1);
  model::Section section = test::ringSection(test::helicalRing(), test::fig3Muscle());
  section.plate = 0.02;
  const model::Arm tooled({section}, test::tool());
  Load load = test::weight(test::Posture::kHorizontal, 0.1, 900);
  load.points = {{0, 1.0, 0.0, {0.1, -0.05, 0.1}, {0, 0, 0}, tooled.link(0).translation}};
  const Eigen::VectorXd q = bare.inputAt(0.3);
  // The offset of a point load says the same without a tool; only the tip is elsewhere.
  const Solution a = LoadedArm(tooled, load, 6).solve(tooled.twists(q));
  const Solution b = LoadedArm(bare, load, 6).solve(bare.twists(q));
  ASSERT_TRUE(a.converged() && b.converged());
  EXPECT_LT(apart(a.tip, b.tip * tooled.link(0)), 1e-12);
  EXPECT_LT((a.shape.pieces() - b.shape.pieces()).norm(), 1e-12);
}

TEST(LoadedLinks, TheCurveOfEveryTierBeginsASectionBeyondItsPlate) {
  const model::Arm arm = test::linkedArm();
  const Load load = spatialLoad(arm);
  const Eigen::VectorXd q = arm.inputAt(0.4);
  for (const TierSetting& setting : {TierSetting{Tier::kLinear, 0}, TierSetting{Tier::kLoaded, 6},
                                     TierSetting{Tier::kExact, 0}}) {
    const ArmModel model(arm, std::nullopt, load, setting);
    const Solution found = model.solve(q);
    const auto curve = model.curve(q, 9);
    for (const auto& point : curve) {
      EXPECT_LT(apart(point.X, model::poseAt(found.shape, point.s)), 2e-3) << setting.name();
    }
    EXPECT_LT(apart(curve[4].X, model::poseAt(found.shape, 1, 0.0)), 1e-8) << setting.name();
    EXPECT_LT(apart(curve[8].X * arm.link(1), found.tip), 1e-8) << setting.name();
    EXPECT_LT(apart(model.tip(q).tip, found.tip), 1e-9) << setting.name();
  }
}

TEST(LoadedLinks, TheInverseCloses) {
  test::Random random(84);
  const model::Arm arm = test::linkedArm();
  model::Section section = test::ringSection(test::straightRing(), test::fig3Muscle());
  section.plate = 0.02;
  const model::Arm one({section}, test::tool());
  InverseSolver two(arm), single(one);
  for (int i = 0; i < 20; ++i) {
    const Eigen::VectorXd q = test::randomInput(arm, random), p = test::randomInput(one, random);
    const InverseResult& pose = two.toPose(arm.tip(q), arm.inputAt(0.5));
    EXPECT_EQ(pose.status, InverseStatus::kReached);
    EXPECT_LT(apart(arm.tip(pose.input), arm.tip(q)), 1e-4);
    const InverseResult& position = single.toPosition(one.tip(p).translation, one.inputAt(0.5));
    EXPECT_EQ(position.status, InverseStatus::kReached);
    EXPECT_LT((one.tip(position.input).translation - one.tip(p).translation).norm(), 1e-5);
  }
  const ArmModel loaded(arm, std::nullopt, spatialLoad(arm), TierSetting{Tier::kLoaded, 3});
  const Eigen::Vector3d target = loaded.tip(arm.inputAt(0.3)).tip.translation;
  InverseSolver under(loaded);
  const InverseResult& found = under.toPosition(target, arm.inputAt(0.5));
  EXPECT_EQ(found.status, InverseStatus::kReached);
  EXPECT_LT((loaded.tip(found.input).tip.translation - target).norm(), 1e-5);
}

}  // namespace
}  // namespace helix_arm::statics
