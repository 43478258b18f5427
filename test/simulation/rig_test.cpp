#include "simulation/rig.hpp"

#include <cmath>
#include <limits>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include <gtest/gtest.h>

#include "helix_arm/model/curve.hpp"
#include "helix_arm/statics/exact.hpp"
#include "simulation/plant.hpp"
#include "support/has.hpp"
#include "support/loaded_arm.hpp"
#include "support/paper_arm.hpp"
#include "support/refusal.hpp"
#include "support/sample_view.hpp"

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

TEST(TrueArm, AForceThatItCannotTakeIsRefusedAndTheOneInEffectStays) {
  const model::Arm arm = ringArm(helicalRing());
  TrueArm unknown(arm, {});
  EXPECT_EQ(refusal([&] {
              unknown.setTipForce({0, 0.1, 0});
            }),
            "arm.stiffness.K_eps_n is missing; expected a finite value > 0 [N] in every section, "
            "which a force at the tip of the true arm needs");
  EXPECT_FALSE(unknown.model().load().has_value());
  TrueArm known(statics::ArmModel(arm, std::nullopt, weightless(1, 1000)), {});
  known.setTipForce({0, 0.1, 0});
  const Eigen::VectorXd q = arm.inputAt(0.3);
  const model::Shape before = known.shape(q);
  for (const double wrong : {std::nan(""), std::numeric_limits<double>::infinity()}) {
    EXPECT_THROW(known.setTipForce({0, wrong, 0}), std::invalid_argument);
    EXPECT_EQ(known.shape(q).pieces(), before.pieces());
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
  deviation.stroke_scales = Eigen::Vector2d(1, 1);
  EXPECT_THROW(TrueArm(arm, deviation), std::invalid_argument);
}

// A rod of mass m and length L that bends evenly by an angle w is at L w s^2 / 2 aside and turned
// by w s, so it has the inertia m (L^2 / 20 + r^2 / 6); its muscles, K_eps each at radius R, resist
// with K_eps / L (3 K_kappa + 3 R^2 / 2). Their shear is much stiffer.
ArmInertia swingingInertia(double damping_time) {
  ArmInertia inertia;
  inertia.motion.damping = {damping_time, damping_time, damping_time, damping_time};
  inertia.motion.step = 5e-4;
  inertia.mass = 0.4;
  inertia.K_eps = 200.0;
  return inertia;
}

TEST(SimulatedRig, AnArmWithInertiaSwingsAboutItsShapeAtRest) {
  constexpr double kTime = 0.01, kStep = 0.001;
  Ring ring = straightRing();
  ring.stiffness.gamma = 1e4;
  const model::Arm arm = ringArm(ring);
  ArmDeviation deviation;
  deviation.inertia = swingingInertia(kTime);
  SimulatedRig rig(arm, {1e-6, 4.5e5, 0, 9}, deviation);
  const model::Twists from = rig.twists();
  const Eigen::Vector3d pressure(4e3, 0, 0);
  const model::Twists step = TrueArm(arm, {}).twists(pressure) - from;
  rig.command(pressure);
  double largest = 0.0, when = 0.0;
  for (int k = 1; k < 600; ++k) {
    rig.step(kStep);
    const double part = (rig.twists() - from)(5, 0) / step(5, 0);
    if (part > largest) largest = part, when = k * kStep;
  }
  const double length = arm.restLength(), radius = ring.radius;
  const double inertia = 0.4 * (length * length / 20 + radius * radius / 6);
  const double stiffness = 200.0 / length * (3 * ring.stiffness.kappa + 1.5 * radius * radius);
  const double w = std::sqrt(stiffness / inertia), zeta = 0.5 * w * kTime;
  const double root = std::sqrt(1 - zeta * zeta);
  EXPECT_NEAR(largest, 1 + std::exp(-M_PI * zeta / root), 0.01);
  EXPECT_NEAR(when, M_PI / (w * root), 0.01 * when);
  for (int k = 0; k < 100; ++k) rig.step(0.1);
  EXPECT_LT((rig.twists() - from - step).norm(), 1e-4 * step.norm());
  rig.command(Eigen::Vector3d::Zero());
  rig.step(INFINITY);
  EXPECT_EQ(rig.twists(), from) << "at rest at once";
}

// Its weight is in its shape at rest; the masses alone move.
TEST(SimulatedRig, AHeavyArmWithInertiaComesToRestWhereItsLoadTakesIt) {
  const model::Arm arm = softHelicalArm();
  const statics::ArmModel model(arm, std::nullopt, horizontalLoad());
  ArmDeviation deviation;
  deviation.inertia = swingingInertia(0.05);
  deviation.inertia->mass.reset();
  deviation.inertia->K_eps.reset();
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

// Readings of another regulator, with times of their own.
TEST(MovingArm, FollowsReadingsAsStepsAndStartsAnewWhereTheirTimeGoesBack) {
  constexpr double kStep = 1.0 / 128;
  const model::Arm arm = ringArm(helicalRing());
  ArmDeviation deviation;
  deviation.dead_time = 2.5 * kStep;
  deviation.response = model::Response{0.1, 0.1, 1, {{{4e3, 0.7}}}};
  deviation.inertia = swingingInertia(0.02);
  simulation::MovingArm reader(arm, deviation);
  Random random(5);
  for (const double start : {100.0, 50.0}) {
    simulation::MovingArm stepped(arm, deviation);
    for (int k = 0; k < 50; ++k) {
      const Eigen::VectorXd pressure = randomInput(arm, random);
      reader.follow(start + kStep * k, pressure);
      stepped.step(pressure, k == 0 ? 0.0 : kStep);
      EXPECT_LT((reader.shape().twists() - stepped.shape().twists()).norm(), 1e-9) << start;
    }
  }
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
  ArmDeviation own;
  own.response = model::Response{0, 0, 1, {{{8e3, 0.75}}}};
  SimulatedRig plays(arm, kRegulator, own);
  for (SimulatedRig* rig : {&lags, &follows, &plays}) {
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
  // The first muscle is on its way down, the others on their way up.
  const Eigen::Vector3d behind = 0.75 * 8e3 * Eigen::Vector3d(1, -1, 0);
  EXPECT_LT((plays.twists() - truth.twists(plays.pressure() + behind)).norm(), 1e-9);
}

// Of two sections with 16 tags each.
class Mounts : public testing::Test {
 protected:
  const model::Arm arm_ = ringArm(helicalRing(), 2);
  const estimation::ArmView view_ = sampleView(0.8, 2, 16);
};

TEST_F(Mounts, TheTagNearestToTheBaseKeepsItsPose) {
  const estimation::ArmView view = deviate(view_, arm_, {0.01, 0.1, 0.01, 0.1, 3});
  const int base = view_.layout.baseTag();
  for (int i = 0; i < static_cast<int>(view.layout.tags.size()); ++i) {
    const auto &before = view_.layout.tags[i], &after = view.layout.tags[i];
    EXPECT_EQ(after.id, before.id);
    EXPECT_EQ(after.section, before.section);
    EXPECT_EQ((after.X_ST.rotation - before.X_ST.rotation).norm() < 1e-6, i == base) << i;
  }
  EXPECT_NO_THROW(view.validate());
}

// ---- Another program as the true arm ------------------------------------------------------------

// A plant that answers every line with the same poses: along z of the base, a quarter turn about y,
// as far out as the first pressure says [m/MPa].
std::string straightPlant(const std::string& more = "") {
  return R"(exec /usr/bin/python3 -c '
import json, sys
first = json.loads(sys.stdin.readline())
def poses(length):
    return [{"position_m": [0, 0, -length * (k + s)], "quaternion_xyzw": [0, 0.5 ** 0.5, 0, 0.5 ** 0.5]}
            for k, s in first["places"]]
print(json.dumps({"ready": True, "poses": poses(1)}), flush=True)
for line in sys.stdin:
    turn = json.loads(line)
    )" + more +
         R"(
    print(json.dumps({"poses": poses(1 + 1e-6 * turn["pressure_pa"][0])}), flush=True)
')";
}

// What a command is refused with as plant of an arm of two sections.
std::string refusalOf(const std::string& command, int steps = 0) {
  std::string refusal;
  try {
    Plant plant(command, ringArm(helicalRing(), 2), {});
    for (int k = 0; k < steps; ++k) plant.step(0.01, Eigen::VectorXd::Zero(6), {0, 0, 0.2});
  } catch (const simulation::PlantError& error) {
    refusal = error.what();
  }
  return refusal;
}

TEST(Plant, ItsPosesAreTheTrueArmOfTheRigThatGivesItPressures) {
  const model::Arm arm = ringArm(helicalRing(), 2);
  SimulatedRig rig(arm, kRegulator, {});
  rig.takeArm(
      std::make_unique<Plant>(straightPlant(), arm, std::vector<estimation::TagPlacement>()));
  rig.command(Eigen::VectorXd::Constant(6, 2e5));
  for (int k = 0; k < 20; ++k) rig.step(0.01);
  const double length = 1 + 1e-6 * rig.pressure()[0];
  ASSERT_GT(length, 1.1);
  for (const double s : {0.25, 1.0, 1.5, 2.0}) {
    const lie::SE3 X = model::poseAt(rig.shape(), s);
    EXPECT_LT((X.translation - Eigen::Vector3d(0, 0, -s * length)).norm(), 1e-9) << s;
  }
  const Eigen::Matrix3d tip = model::tipPose(rig.shape()).rotation;
  EXPECT_LT((tip.col(0) + Eigen::Vector3d::UnitZ()).norm(), 1e-9) << "x is not along the arm";
}

TEST(Plant, ItGetsTheForceAtTheTipAndTheTimeOfATurn) {
  const std::string refusal = refusalOf(
      straightPlant(R"(assert turn["force"] is None, json.dumps([turn["force"], turn["dt_s"]]))"),
      1);
  EXPECT_TRUE(has(refusal, "ended with exit code 1")) << refusal;
  const std::string same = straightPlant(
      R"(assert turn["force"] == {"section": 1, "s": 1.0, "force_n": [0, 0, 0.2]} and turn["dt_s"] == 0.01)");
  EXPECT_EQ(refusalOf(same, 3), "");
}

TEST(Plant, PiecesEndWhereTagsAre) {
  estimation::TagPlacement tag{};
  tag.section = 0;
  tag.s = 1.0 / 13;  // not at the end of a piece of the usual length
  const Plant plant(straightPlant(), ringArm(helicalRing(), 2), {tag});
  EXPECT_EQ(plant.shape().piecesPerSection() % 13, 0);
}

}  // namespace
}  // namespace helix_arm::test
