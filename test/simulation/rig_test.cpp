#include "helix_arm/simulation/rig.hpp"

#include <cmath>
#include <limits>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include <gtest/gtest.h>

#include "helix_arm/model/curve.hpp"
#include "helix_arm/statics/exact.hpp"
#include "support/has.hpp"
#include "support/paper_arm.hpp"
#include "support/refusal.hpp"
#include "support/sample_load.hpp"
#include "support/sample_view.hpp"
#include "tag_studio.hpp"

namespace helix_arm::test {
namespace {

using namespace simulation;

const regulator::SimulatedRegulatorConfig kRegulator{0.12, 4.5e5, 4e3, 9};

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
  ArmDeviation loose;
  loose.response = model::Response{-1, 0, 0, {}};
  EXPECT_THROW(loose.validate(), std::invalid_argument);
  EXPECT_EQ(refusal([] {
              ArmDeviation{1, -2, 1}.validate();
            }),
            "true arm: the factor on K_kappa is -2; expected a finite value > 0");
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

// Nothing that loads an arm whose stiffness is known.
statics::Load onlyStiffness(int sections = 1, double K_eps = 1000.0) {
  return {Eigen::Vector3d::Zero(),
          std::vector<double>(sections, 0.0),
          std::vector<double>(sections, K_eps),
          {},
          {}};
}

Eigen::Vector3d tipOf(const model::Shape& shape) { return model::tipPose(shape).translation; }

TEST(TrueArm, AForceAlongAStraightArmStretchesItByHookesLaw) {
  const model::Arm arm = ringArm(straightRing());
  const double length_scale = 1.02, K_eps = 0.8 * 900.0, force = 2.0;
  TrueArm truth(statics::ArmModel(arm, std::nullopt, onlyStiffness(1, 900.0)),
                {1, 1, length_scale, 0.8});
  const Eigen::Vector3d q = Eigen::Vector3d::Zero(), before = tipOf(truth.shape(q));
  const double length = arm.restLength();
  EXPECT_LT((before - Eigen::Vector3d(length_scale * length, 0, 0)).norm(), 1e-12);
  truth.setTipForce({force, 0, 0});
  const Eigen::Vector3d stretch(length * force / (3 * K_eps), 0, 0);  // three muscles
  EXPECT_LT((tipOf(truth.shape(q)) - before - stretch).norm(), 1e-3 * stretch.norm());
  truth.setTipForce({-force, 0, 0});
  EXPECT_LT((tipOf(truth.shape(q)) - before + stretch).norm(), 1e-3 * stretch.norm());
}

TEST(TrueArm, AForceAtTheTipIsAPointLoadOnTopOfTheScenes) {
  Ring ring = helicalRing();
  const model::Arm arm = ringArm(ring, 2);
  ring.stiffness.gamma *= 0.7;
  ring.stiffness.kappa *= 1.4;
  const model::Arm stiffer = ringArm(ring, 2);
  for (const statics::Load& load : {onlyStiffness(2), horizontalLoad(2)}) {
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
      EXPECT_EQ(truth.tipForce(), force);
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

TEST(TrueArm, WithoutAForceAtTheTipNotABitChanges) {
  const model::Arm arm = ringArm(helicalRing());
  const ArmDeviation deviation{0.7, 1.4, 1.02, 0.8};
  const statics::ArmModel unknown(arm), known(arm, std::nullopt, onlyStiffness()),
      loaded(arm, std::nullopt, horizontalLoad());
  for (const auto& [scene, plain] : {std::pair{known, unknown}, {known, known}, {loaded, loaded}}) {
    TrueArm truth(scene, deviation);
    const TrueArm untouched(plain, deviation);
    Random random(6);
    for (int i = 0; i < 10; ++i) {
      const Eigen::VectorXd q = randomInput(arm, random);
      EXPECT_EQ(truth.shape(q).pieces(), untouched.shape(q).pieces());
      EXPECT_EQ(truth.model().choice().setting.name(), untouched.model().choice().setting.name());
      truth.setTipForce({0, 0.5, 0});
      EXPECT_GT((tipOf(truth.shape(q)) - tipOf(untouched.shape(q))).norm(), 1e-4);
      truth.setTipForce({0, -0.0, 0});
    }
  }
  TrueArm truth(unknown, deviation);
  EXPECT_NO_THROW(truth.setTipForce(Eigen::Vector3d::Zero()));
}

TEST(TrueArm, AForceThatItCannotTakeIsRefusedAndTheOneInEffectStays) {
  const model::Arm arm = ringArm(helicalRing());
  TrueArm unknown(arm, {});
  EXPECT_EQ(refusal([&] {
              unknown.setTipForce({0, 0.1, 0});
            }),
            "arm.stiffness.K_eps_n is missing; expected a finite value > 0 [N] in every section, "
            "which a force at the tip of the true arm needs");
  EXPECT_EQ(unknown.tipForce(), Eigen::Vector3d::Zero());
  TrueArm known(statics::ArmModel(arm, std::nullopt, onlyStiffness()), {});
  known.setTipForce({0, 0.1, 0});
  const Eigen::VectorXd q = arm.inputAt(0.3);
  const model::Shape before = known.shape(q);
  for (const double wrong : {std::nan(""), std::numeric_limits<double>::infinity()}) {
    EXPECT_THROW(known.setTipForce({0, wrong, 0}), std::invalid_argument);
    EXPECT_EQ(known.tipForce(), Eigen::Vector3d(0, 0.1, 0));
    EXPECT_EQ(known.shape(q).pieces(), before.pieces());
  }
}

TEST(TrueArm, AForceThatNoShapeBalancesIsNamed) {
  const model::Arm arm = ringArm(helicalRing());
  TrueArm truth(statics::ArmModel(arm, std::nullopt, onlyStiffness(1, 1e-3)), {});
  truth.setTipForce({-80, 3, 0});
  EXPECT_TRUE(has(refusal<std::runtime_error>([&] { truth.shape(arm.inputAt(0.3)); }),
                  "no shape balances the force (-80, 3, 0) N at the tip ("));
}

TEST(SimulatedRig, AForceAtTheTipBendsTheTrueArmAndThePressuresStay) {
  const model::Arm arm = ringArm(helicalRing());
  const statics::ArmModel known(arm, std::nullopt, onlyStiffness());
  SimulatedRig rig(known, kRegulator, {}), untouched(known, kRegulator, {});
  TrueArm truth(known, {});
  const Eigen::Vector3d force(0.1, -0.3, 0.2);
  rig.setTipForce(force);
  truth.setTipForce(force);
  for (SimulatedRig* one : {&rig, &untouched}) {
    one->command(arm.inputAt(0.5));
    one->step(0.1);
  }
  EXPECT_EQ(rig.pressure(), untouched.pressure());
  EXPECT_EQ(rig.shape().pieces(), truth.shape(rig.pressure()).pieces());
  EXPECT_GT((tipOf(rig.shape()) - tipOf(untouched.shape())).norm(), 1e-4);
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

// On the way up the shape is that of a pressure which is lower by the weight of the play, on the
// way down of one which is higher; a motion within twice the play moves it by the rest of the
// weight.
TEST(SimulatedRig, MusclesWithPlayStayBehindTheirPressures) {
  constexpr double kPlay = 8e3, kWeight = 0.75;
  const model::Arm arm = ringArm(helicalRing());
  ArmDeviation deviation;
  deviation.response = model::Response{0, 0, 1, {{{kPlay, kWeight}}}};
  SimulatedRig rig(arm, kRegulator, deviation);
  const TrueArm truth(arm, deviation);
  const Eigen::Vector3d play = Eigen::Vector3d::Constant(kPlay);
  const auto goTo = [&rig](const Eigen::Vector3d& pressure) {
    rig.command(pressure);
    rig.step(100);
  };
  const Eigen::Vector3d high(2e5, 3e5, 1e5);
  goTo(high);
  ASSERT_LT((rig.pressure() - high).norm(), 1e-6);
  const auto feels = [&](double plays) {  // below the highest pressure
    return (rig.twists() - truth.twists(high - plays * play)).norm() < 1e-9;
  };
  EXPECT_TRUE(feels(kWeight));
  goTo(high - 1.6 * play);
  EXPECT_TRUE(feels(1.6 * (1 - kWeight) + kWeight));
  goTo(high - 5 * play);
  EXPECT_TRUE(feels(5 - kWeight));
  goTo(high - 3.4 * play);
  EXPECT_TRUE(feels(3.4 * (1 - kWeight) + 4 * kWeight));
  goTo(high);
  EXPECT_TRUE(feels(kWeight));
}

TEST(SimulatedRig, TheResponseOfTheTrueArmIsTheScenesUnlessItSaysOtherwise) {
  model::Arm plain = ringArm(helicalRing());
  std::vector<model::Section> sections(1);
  for (int i = 0; i < 3; ++i) {
    sections[0].actuators.push_back(plain.actuator(i));
    sections[0].actuators.back().response = model::Response{0.4, 0.4, 0, {}};
  }
  const model::Arm arm(std::move(sections));
  SimulatedRig lags(arm, kRegulator, {});
  ArmDeviation none;
  none.response = model::Response{};
  SimulatedRig follows(arm, kRegulator, none);
  for (SimulatedRig* rig : {&lags, &follows}) {
    rig->command(Eigen::Vector3d(2e5, 1e5, 0));
    rig->step(100);
    rig->command(Eigen::Vector3d(0, 1e5, 0));
    rig->step(0.4);
  }
  const TrueArm truth(arm, {});
  EXPECT_EQ(follows.twists(), truth.twists(follows.pressure()));
  const double p = lags.pressure()[0];
  const Eigen::Vector3d effective(p + (2e5 - p) * std::exp(-1.0), 1e5, 0);
  EXPECT_LT((lags.twists() - truth.twists(effective)).norm(), 1e-9);
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
