#include "helix_arm/simulation/rig.hpp"

#include <cmath>
#include <limits>
#include <stdexcept>

#include <gtest/gtest.h>

#include "helix_arm/model/curve.hpp"
#include "helix_arm/statics/exact.hpp"
#include "support/paper_arm.hpp"
#include "support/sample_load.hpp"
#include "support/sample_view.hpp"
#include "tag_studio.hpp"

namespace helix_arm::test {
namespace {

using simulation::ArmDeviation;
using simulation::CameraSetup;
using simulation::SimulatedRig;
using simulation::TrueArm;

const regulator::SimulatedRegulatorConfig kRegulator{0.12, 4.5e5, 4e3, 9};

TEST(TrueArm, WithoutDeviationItIsTheArmOfTheScene) {
  const model::Arm arm = ringArm(helicalRing(), 2);
  const TrueArm truth(arm, {});
  Random random(1);
  for (int i = 0; i < 50; ++i) {
    const Eigen::VectorXd q = randomInput(arm, random);
    EXPECT_LT((truth.twists(q) - arm.twists(q)).cwiseAbs().maxCoeff(), 1e-11);
  }
}

TEST(TrueArm, StiffnessAndLengthsDeviateAsAsked) {
  const ArmDeviation deviation{0.7, 1.4, 1.02};
  Ring ring = helicalRing();
  const model::Arm arm = ringArm(ring, 2);
  ring.stiffness.gamma *= 0.7;
  ring.stiffness.kappa *= 1.4;
  const model::Arm expected = ringArm(ring, 2);
  const TrueArm truth(arm, deviation);
  Random random(2);
  for (int i = 0; i < 50; ++i) {
    const Eigen::VectorXd q = randomInput(arm, random);
    const model::Twists twists = expected.twistsOfLengths(1.02 * expected.lengths(q));
    EXPECT_LT((truth.twists(q) - twists).cwiseAbs().maxCoeff(), 1e-11);
    EXPECT_GT((truth.twists(q) - arm.twists(q)).cwiseAbs().maxCoeff(), 1e-3);
  }
}

TEST(TrueArm, EachLengthMayDeviateByItself) {
  const model::Arm arm = ringArm(helicalRing());
  ArmDeviation deviation;
  deviation.length_scale = 1.02;
  deviation.length_scales = Eigen::Vector3d(0.98, 1, 1.01);
  const TrueArm truth(arm, deviation);
  const Eigen::Vector3d scales = 1.02 * deviation.length_scales;
  Random random(3);
  for (int i = 0; i < 20; ++i) {
    const Eigen::VectorXd q = randomInput(arm, random);
    const model::Twists twists = arm.twistsOfLengths(scales.cwiseProduct(arm.lengths(q)));
    EXPECT_LT((truth.twists(q) - twists).cwiseAbs().maxCoeff(), 1e-11);
  }
}

TEST(TrueArm, PressuresBeyondTheLimitsCountAsTheLimits) {
  const model::Arm arm = ringArm(straightRing());
  const TrueArm truth(arm, {1.1, 0.9, 0.99});
  const Eigen::Vector3d beyond(-1e4, 2e5, 2 * kMaxPressure), at(0, 2e5, kMaxPressure);
  EXPECT_EQ(truth.twists(beyond), truth.twists(at));
}

TEST(TrueArm, WhatIsNoPressureOrNoFactorIsRefused) {
  const model::Arm arm = ringArm(straightRing());
  const TrueArm truth(arm, {});
  EXPECT_THROW(truth.twists(Eigen::Vector2d(0, 0)), std::invalid_argument);
  EXPECT_THROW(truth.twists(Eigen::VectorXd::Zero(4)), std::invalid_argument);
  EXPECT_THROW(truth.twists(Eigen::Vector3d(0, std::nan(""), 0)), std::out_of_range);
  for (const double wrong : {0.0, -1.0, std::nan(""), std::numeric_limits<double>::infinity()}) {
    for (const ArmDeviation& deviation :
         {ArmDeviation{wrong, 1, 1}, ArmDeviation{1, wrong, 1}, ArmDeviation{1, 1, wrong},
          ArmDeviation{1, 1, 1, wrong}}) {
      EXPECT_THROW(deviation.validate(), std::invalid_argument);
      EXPECT_THROW(TrueArm(arm, deviation), std::invalid_argument);
    }
  }
  ArmDeviation each;
  each.length_scales = Eigen::Vector3d(1, 0, 1);
  EXPECT_THROW(each.validate(), std::invalid_argument);
  each.length_scales = Eigen::Vector2d(1, 1);
  EXPECT_THROW(TrueArm(arm, each), std::invalid_argument);
  try {
    ArmDeviation{1, -2, 1}.validate();
  } catch (const std::invalid_argument& error) {
    EXPECT_STREQ(error.what(),
                 "true arm: the factor on K_kappa is -2; expected a finite value > 0");
  }
}

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

TEST(TrueArm, ALoadThatPullsNothingIsNone) {
  const model::Arm arm = ringArm(helicalRing());
  statics::Load load = horizontalLoad();
  load.gravity.setZero();
  const ArmDeviation deviation{1.1, 0.9, 1.01, 0.5};
  const TrueArm with(statics::ArmModel(arm, std::nullopt, load), deviation),
      without(arm, deviation);
  const Eigen::VectorXd q = arm.inputAt(0.3);
  EXPECT_EQ(with.shape(q).pieces(), without.shape(q).pieces());
}

TEST(SimulatedRig, PressuresAreThoseOfItsRegulatorsAndTheArmFollowsThem) {
  const model::Arm arm = ringArm(helicalRing());
  const ArmDeviation deviation{1.0, 1.2, 1.01};
  SimulatedRig rig(arm, kRegulator, deviation);
  regulator::SimulatedRegulator regulator(3, kRegulator);
  const TrueArm truth(arm, deviation);
  Random random(3);
  EXPECT_EQ(rig.twists(), truth.twists(Eigen::VectorXd::Zero(3)));
  for (int i = 0; i < 20; ++i) {
    const Eigen::VectorXd set_point = randomInput(arm, random);
    rig.command(set_point);
    regulator.command(set_point);
    for (const double dt : {0.0, 0.01, 0.2}) {
      rig.step(dt);
      regulator.step(dt);
      EXPECT_EQ(rig.pressure(), regulator.pressure());
      EXPECT_EQ(rig.measure(), regulator.measure());
      EXPECT_EQ(rig.twists(), truth.twists(regulator.pressure()));
    }
  }
  EXPECT_THROW(rig.command(Eigen::Vector2d(0, 0)), std::invalid_argument);
  EXPECT_THROW(rig.step(-1), std::invalid_argument);
}

TEST(SimulatedRig, ThePictureIsThatOfTheTrueArm) {
  const model::Arm arm = ringArm(helicalRing());
  const CameraSetup setup{
      studio(plainCamera(), {{facingCamera(), {0, 0, 0.3}}}), vision::TagFamily("36h11"), {}, {}};
  SimulatedRig rig(arm, kRegulator, {1, 1, 1.05}, setup);
  simulation::SimulatedCamera camera(setup.view, setup.family, setup.body, setup.config);
  ASSERT_TRUE(rig.hasCamera());
  rig.command(Eigen::Vector3d(3e5, 1e5, 0));
  for (int i = 0; i < 3; ++i) {
    rig.step(0.1);
    EXPECT_EQ(cv::norm(rig.render(), camera.render(rig.twists()), cv::NORM_INF), 0);
  }
}

TEST(SimulatedRig, ThePictureOfALoadedArmShowsItsLoad) {
  const model::Arm arm = ringArm(helicalRing());
  const statics::ArmModel loaded(arm, std::nullopt, horizontalLoad());
  const CameraSetup setup{sampleView(), vision::TagFamily("36h11"), {}, {}};
  SimulatedRig rig(loaded, kRegulator, {}, setup);
  simulation::SimulatedCamera same(setup.view, setup.family, setup.body, setup.config);
  simulation::SimulatedCamera other(setup.view, setup.family, setup.body, setup.config);
  const cv::Mat picture = rig.render().clone();
  EXPECT_EQ(cv::norm(picture, same.render(rig.trueArm().shape(rig.pressure())), cv::NORM_INF), 0);
  EXPECT_GT(cv::norm(picture, other.render(rig.twists()), cv::NORM_INF), 0);
}

TEST(SimulatedRig, WithoutACameraThereIsNoPicture) {
  SimulatedRig rig(ringArm(straightRing()), kRegulator, {});
  EXPECT_FALSE(rig.hasCamera());
  EXPECT_THROW(rig.render(), std::logic_error);
}

TEST(SimulatedRig, PartsThatDoNotFitAreRefused) {
  const CameraSetup setup{studio(plainCamera(), {}), vision::TagFamily("36h11"), {}, {}};
  EXPECT_THROW(SimulatedRig(ringArm(straightRing(), 2), kRegulator, {}, setup),
               std::invalid_argument);
  EXPECT_THROW(SimulatedRig(ringArm(straightRing()), {0.0}, {}), std::invalid_argument);
  EXPECT_THROW(SimulatedRig(ringArm(straightRing()), kRegulator, {-1}), std::invalid_argument);
}

}  // namespace
}  // namespace helix_arm::test
