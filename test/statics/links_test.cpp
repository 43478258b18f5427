// Plates and tools in every tier, with and without load.
#include <gtest/gtest.h>

#include "helix_arm/model/curve.hpp"
#include "helix_arm/statics/arm_model.hpp"
#include "helix_arm/statics/exact.hpp"
#include "helix_arm/statics/inverse.hpp"
#include "helix_arm/statics/jacobian.hpp"
#include "helix_arm/statics/loaded.hpp"
#include "helix_arm/statics/workspace.hpp"
#include "support/linked_arm.hpp"

namespace helix_arm::statics {
namespace {

double apart(const lie::SE3& a, const lie::SE3& b) {
  return (a.translation - b.translation).norm() + (a.rotation - b.rotation).norm();
}

// A weight along the arm, a force at the tool's tip, and a mass where the second section begins.
Load loadOf(const model::Arm& arm, const Eigen::Vector3d& gravity, const Eigen::Vector3d& force) {
  Load load;
  load.gravity = gravity;
  load.mass = {0.1, 0.08};
  load.K_eps = {900, 900};
  PointLoad tip;
  tip.section = 1;
  tip.force = force;
  tip.offset = arm.link(1).translation;
  PointLoad joint;
  joint.section = 1;
  joint.s = 0;
  joint.mass = 0.03;
  joint.offset = {0.0, 0.02, 0.0};
  load.points = {tip, joint};
  return load;
}

Load spatialLoad(const model::Arm& arm) { return loadOf(arm, {5, 0, -8}, {0.05, 0.1, -0.08}); }

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

TEST(LoadedLinks, EveryOrderMeetsItsStatedErrorAgainstTheExactTier) {
  const model::Arm arm = test::linkedArm();
  const Load load = spatialLoad(arm);
  const ExactArm exact(arm, load);
  test::Random random(81);
  for (int i = 0; i < 10; ++i) {
    const model::Twists twists = arm.twists(test::randomInput(arm, random));
    const Solution reference = exact.solve(twists);
    ASSERT_TRUE(reference.converged());
    EXPECT_GT((reference.tip.translation - arm.tipOf(twists).translation).norm(), 2e-3);
    EXPECT_LT(apart(model::tipPose(reference.shape), reference.tip), 1e-9);
    for (const int order : {2, 3, 5, 8}) {
      const Solution found = LoadedArm(arm, load, order).solve(twists);
      ASSERT_TRUE(found.converged());
      const double off = (found.tip.translation - reference.tip.translation).norm();
      EXPECT_LT(off, (order == 8 ? 1e-7 : statedTipError(order)) * arm.restLength()) << order;
      EXPECT_LT(apart(model::tipPose(found.shape), found.tip), 1e-9);
    }
  }
}

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
  Load load;
  load.gravity = {3, -2, -8};
  load.mass = {0.1, 0.08};
  load.K_eps = {900, 900};
  PointLoad tip;
  tip.section = 1;
  tip.mass = 0.03;
  load.points = {tip};
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
  const model::Arm arm = test::linkedArm();
  const model::Arm bare = test::ringArm(test::helicalRing(), 1);
  model::Section section = test::ringSection(test::helicalRing(), test::fig3Muscle());
  section.plate = 0.02;
  const model::Arm tooled({section}, test::tool());
  Load load = test::weight(test::Posture::kHorizontal, 0.1, 900);
  PointLoad tip;
  tip.force = {0.1, -0.05, 0.1};
  tip.offset = tooled.link(0).translation;
  load.points = {tip};
  const Eigen::VectorXd q = bare.inputAt(0.3);
  // The offset of a point load says the same without a tool; only the tip is elsewhere.
  const Solution a = LoadedArm(tooled, load, 6).solve(tooled.twists(q));
  const Solution b = LoadedArm(bare, load, 6).solve(bare.twists(q));
  ASSERT_TRUE(a.converged() && b.converged());
  EXPECT_LT(apart(a.tip, b.tip * tooled.link(0)), 1e-12);
  EXPECT_LT((a.shape.pieces() - b.shape.pieces()).norm(), 1e-12);
}

TEST(LoadedLinks, ThePlaneAgreesWithSpace) {
  const model::PlanarArm flat = test::linkedPlanarArm();
  const model::Arm arm = model::embed(flat);
  const Load load = loadOf(arm, {3, -8, 0}, {0.05, 0.1, 0});
  ASSERT_TRUE(inPlane(load));
  test::Random random(83);
  for (int i = 0; i < 10; ++i) {
    const Eigen::VectorXd q = test::randomInput(arm, random);
    const Solution plane = PlanarLoadedArm(flat, load, 5).solve(flat.twists(q));
    const Solution space = LoadedArm(arm, load, 5).solve(arm.twists(q));
    ASSERT_TRUE(plane.converged() && space.converged());
    EXPECT_LT(apart(plane.tip, space.tip), 1e-9);
    EXPECT_LT(apart(model::tipPose(plane.shape), plane.tip), 1e-9);
  }
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

TEST(LoadedLinks, TheJacobianOfEveryTierAgreesWithDifferences) {
  const model::Arm arm = test::linkedArm();
  const Load load = spatialLoad(arm);
  const Eigen::VectorXd lengths = arm.lengths(arm.inputAt(0.4));
  constexpr double kStep = 1e-5;
  for (const TierSetting& setting : {TierSetting{Tier::kLinear, 0}, TierSetting{Tier::kLoaded, 4},
                                     TierSetting{Tier::kExact, 0}}) {
    const ArmModel model(arm, std::nullopt, load, setting);
    const TipResponse response = model.tipResponse(lengths);
    for (int i = 0; i < lengths.size(); ++i) {
      const Eigen::VectorXd step = kStep * Eigen::VectorXd::Unit(lengths.size(), i);
      const lie::Vector6 expected = (model.tipOfLengths(lengths - step).tip.inverse() *
                                     model.tipOfLengths(lengths + step).tip)
                                        .log() /
                                    (2 * kStep);
      EXPECT_LT((response.by_lengths.col(i) - expected).norm(), 1e-4 * expected.norm())
          << setting.name() << ", " << i;
    }
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

TEST(LoadedLinks, TheWorkspaceIsThatOfTheTip) {
  const ArmModel model(test::linkedArm());
  const WorkspacePoints points = Workspace(model).sample(0, 300);
  for (int row = 0; row < points.count(); ++row) {
    const Eigen::VectorXd q = points.inputs.row(row);
    EXPECT_LT((points.tips.row(row).transpose() - model.arm().tip(q).translation).norm(), 1e-13);
  }
}

TEST(LoadedLinks, DerivativesByInputAndByTipLoad) {
  const model::Arm arm = test::linkedArm();
  const Eigen::VectorXd q = arm.inputAt(0.4);
  Load none;
  none.mass = {0, 0};
  none.K_eps = {900, 900};
  const ArmModel unloaded(arm, std::nullopt, none, TierSetting{Tier::kLinear, 0});
  const ArmModel loaded(arm, std::nullopt, spatialLoad(arm), TierSetting{Tier::kLoaded, 6});
  expectJacobian(unloaded, q, 1e-6);
  expectJacobian(loaded, q, 1e-5);
  // A small force on the tool's tip.
  const ShapeJacobian found = jacobianAt(unloaded, q);
  ASSERT_TRUE(found.by_load);
  constexpr double kForce = 1e-4;
  for (int axis = 0; axis < 3; ++axis) {
    Eigen::Vector3d ends[2];
    for (const int side : {0, 1}) {
      Load load = none;
      load.points.push_back({});
      load.points.back().section = 1;
      load.points.back().offset = arm.link(1).translation;
      load.points.back().force = (side == 0 ? -kForce : kForce) * Eigen::Vector3d::Unit(axis);
      ends[side] = ExactArm(arm, load).solve(arm.twists(q)).tip.translation;
    }
    const Eigen::Vector3d expected = (ends[1] - ends[0]) / (2 * kForce);
    EXPECT_LT((found.by_load->tip.col(axis).head<3>() - expected).norm(), 1e-5 * expected.norm());
  }
}

}  // namespace
}  // namespace helix_arm::statics
