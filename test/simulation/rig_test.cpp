#include "simulation/rig.hpp"

#include <gtest/gtest.h>

#include "helix_arm/model/curve.hpp"
#include "helix_arm/statics/exact.hpp"
#include "support/loaded_arm.hpp"
#include "support/paper_arm.hpp"
#include "support/sample_view.hpp"

namespace helix_arm::test {
namespace {

using namespace simulation;

const regulator::SimulatedRegulatorConfig kRegulator{0.12, 4.5e5, 4e3, 9};

TEST(TrueArm, UnderLoadItIsTheExactArmWhateverTierTheSceneAsksFor) {
  Ring ring = helicalRing();
  const model::Arm arm = ringArm(ring, 2);
  statics::Load load = horizontalLoad(2);
  statics::TierRequest request;
  request.tier = statics::Tier::kLoaded;
  request.order = 2;
  const TrueArm truth(statics::ArmModel(arm, std::nullopt, load, request), {0.7, 1.4, 1.02, 0.8});
  EXPECT_EQ(truth.model().choice().setting.tier, statics::Tier::kExact);
  ring.stiffness.gamma *= 0.7;
  ring.stiffness.kappa *= 1.4;
  for (double& K_eps : load.K_eps) K_eps *= 0.8;
  const model::Arm stiffer = ringArm(ring, 2);
  const statics::ExactArm exact(stiffer, load);
  Random random(4);
  for (int i = 0; i < 10; ++i) {
    const Eigen::VectorXd q = randomInput(arm, random);
    const model::Twists unloaded = stiffer.twistsOfLengths(1.02 * stiffer.lengths(q));
    const statics::Solution expected = exact.solve(unloaded);
    ASSERT_TRUE(expected.converged());
    const model::Shape shape = truth.shape(q);
    EXPECT_GT(shape.piecesPerSection(), 1);
    EXPECT_LT((shape.pieces() - expected.shape.pieces()).cwiseAbs().maxCoeff(), 1e-8);
    EXPECT_LT((model::tipPose(shape).translation - expected.tip.translation).norm(), 1e-8);
    // And the load is no trifle.
    EXPECT_GT((model::tipPose(shape).translation - model::tipPose(unloaded).translation).norm(),
              0.01);
  }
}

Eigen::Vector3d tipOf(const model::Shape& shape) { return model::tipPose(shape).translation; }

TEST(TrueArm, AForceAtTheTipIsAPointLoadOnTopOfTheScenes) {
  Ring ring = helicalRing();
  const model::Arm arm = ringArm(ring, 2);
  ring.stiffness.gamma *= 0.7;
  ring.stiffness.kappa *= 1.4;
  const model::Arm stiffer = ringArm(ring, 2);
  for (const statics::Load& load : {weightless(2, 1000), horizontalLoad(2)}) {
    TrueArm truth(statics::ArmModel(arm, std::nullopt, load), {0.7, 1.4, 1.02, 0.8});
    Random random(5);
    for (int i = 0; i < 10; ++i) {
      const Eigen::Vector3d force = random.uniform(0.1, 2.0) * random.direction<3>();
      statics::Load both = load;
      for (double& K_eps : both.K_eps) K_eps *= 0.8;
      both.points.push_back({1, 1.0, 0.0, force, {0, 0, 0}, {0, 0, 0}});
      const statics::TierSetting exact{statics::Tier::kExact, 0};
      const statics::ArmModel expected(stiffer, std::nullopt, both, exact);
      const Eigen::VectorXd q = randomInput(arm, random);
      const Eigen::Vector3d before = tipOf(truth.shape(q));
      truth.setTipForce(force);
      const Eigen::Vector3d displacement = tipOf(truth.shape(q)) - before;
      EXPECT_LT(
          (tipOf(truth.shape(q)) - expected.tipOfLengths(1.02 * stiffer.lengths(q)).tip.translation)
              .norm(),
          1e-8);
      EXPECT_GT(displacement.dot(force), 0.0) << "it yields to the force";
      truth.setTipForce(Eigen::Vector3d::Zero());
    }
  }
}

TEST(TrueArm, LengthsStrokesAndStiffnessMayDifferFromMuscleToMuscle) {
  const model::Arm arm = ringArm(helicalRing());
  ArmDeviation deviation;
  deviation.length_scale = 1.02;
  deviation.length_scales = Eigen::Vector3d(0.98, 1, 1.01);
  deviation.stroke_scales = Eigen::Vector3d(1.1, 0.9, 1);
  deviation.stiffness_scales = Eigen::Vector3d(1, 1.3, 0.8);
  const TrueArm truth(arm, deviation);
  model::Arm expected = arm;
  for (const int i : {1, 2}) {
    const double scale = deviation.stiffness_scales[i];
    const model::Stiffness& known = arm.actuator(i).stiffness;
    expected =
        expected.withStiffness(i, {scale * known.gamma, scale * known.tau, scale * known.kappa});
  }
  Random random(5);
  for (int k = 0; k < 20; ++k) {
    const Eigen::VectorXd q = randomInput(arm, random);
    Eigen::VectorXd lengths = arm.lengths(q);
    for (int i = 0; i < 3; ++i) {
      const double rest = arm.actuator(i).contraction.restLength();
      lengths[i] = 1.02 * deviation.length_scales[i] *
                   (rest + deviation.stroke_scales[i] * (lengths[i] - rest));
    }
    EXPECT_LT((truth.twists(q) - expected.twistsOfLengths(lengths)).cwiseAbs().maxCoeff(), 1e-11);
  }
}

// Its weight is in its shape at rest; the masses alone move.
TEST(SimulatedRig, AHeavyArmWithInertiaComesToRestWhereItsLoadTakesIt) {
  const model::Arm arm = softHelicalArm();
  const statics::ArmModel model(arm, std::nullopt, horizontalLoad());
  ArmDeviation deviation;
  deviation.inertia.emplace();
  deviation.inertia->motion.damping = {0.05, 0.05, 0.05, 0.05};
  deviation.inertia->motion.step = 5e-4;
  SimulatedRig rig(model, kRegulator, deviation);
  rig.command(Eigen::Vector3d(2e5, 0, 1e5));
  for (int k = 0; k < 300; ++k) rig.step(0.01);
  EXPECT_LT((rig.twists() - TrueArm(model, {}).twists(rig.pressure())).norm(), 1e-6);
}

TEST(SimulatedRig, TheArmFollowsItsPressuresLateByTheDeadTime) {
  const model::Arm arm = ringArm(helicalRing());
  ArmDeviation deviation;
  deviation.dead_time = 0.05;
  SimulatedRig late(arm, kRegulator, deviation), prompt(arm, kRegulator, {});
  for (SimulatedRig* rig : {&late, &prompt}) rig->command(Eigen::Vector3d(2e5, 0, 1e5));
  for (int k = 0; k < 10; ++k) prompt.step(0.01);
  for (int k = 0; k < 15; ++k) late.step(0.01);
  EXPECT_LT((late.twists() - prompt.twists()).norm(), 1e-12);
}

TEST(Mounts, TheTagNearestToTheBaseKeepsItsPose) {
  const estimation::ArmView known = sampleView(0.8, 2, 16);
  const estimation::ArmView view =
      deviate(known, ringArm(helicalRing(), 2), {0.01, 0.1, 0.01, 0.1, 3});
  const int base = known.layout.baseTag();
  for (int i = 0; i < static_cast<int>(view.layout.tags.size()); ++i) {
    const auto &before = known.layout.tags[i], &after = view.layout.tags[i];
    EXPECT_EQ(after.id, before.id);
    EXPECT_EQ(after.section, before.section);
    EXPECT_EQ((after.X_ST.rotation - before.X_ST.rotation).norm() < 1e-6, i == base) << i;
  }
  EXPECT_NO_THROW(view.validate());
}

}  // namespace
}  // namespace helix_arm::test
