#include "helix_arm/statics/tier.hpp"

#include <algorithm>
#include <string>

#include <gtest/gtest.h>

#include "helix_arm/statics/arm_model.hpp"
#include "helix_arm/statics/exact.hpp"
#include "helix_arm/statics/loaded.hpp"
#include "statics/arms_under_load.hpp"
#include "support/has.hpp"
#include "support/loaded_arm.hpp"
#include "support/refusal.hpp"
#include "support/test_size.hpp"

namespace helix_arm::statics {
namespace {

using test::Posture;

Load weightIn(const Eigen::Vector3d& direction) {
  Load load = test::weight(Posture::kHanging, 0.2, 900);
  load.gravity = test::kGravity * direction;
  return load;
}

TEST(TierChoice, WithoutLoadTheClosedFormsServeAndATimeBuysAccuracyUnderOne) {
  const model::Arm arm = test::softHelicalArm();
  const model::PlanarArm plane = test::planarArm();
  EXPECT_EQ(chooseTier(arm, {}, {}, {}).setting.tier, Tier::kLinear);
  EXPECT_EQ(chooseTier(model::embed(plane), plane, {}, {}).setting.tier, Tier::kPlanar);
  Load load = weightIn(-Eigen::Vector3d::UnitZ());
  TierRequest by_time;
  by_time.time = 1.0;
  EXPECT_LE(chooseTier(arm, {}, load, by_time).relative_tip_error, 1e-9);
  by_time.time = 1e-12;
  const auto refusal = [&load](const model::Arm& of, const auto& in, const TierRequest& wanted) {
    return test::refusal([&] { chooseTier(of, in, load, wanted); });
  };
  EXPECT_TRUE(test::has(refusal(arm, std::optional<model::PlanarArm>(), by_time), "budget"));
  EXPECT_TRUE(
      test::has(refusal(model::embed(plane), plane, request(Tier::kPlanar)), "tier: loaded"));
  load.mass = {1e6};
  EXPECT_TRUE(test::has(refusal(arm, std::optional<model::PlanarArm>(), {}), "lower the masses"));
}

TEST(TierChoice, LoadsInThePlaneOfAPlanarArmAreSolvedThere) {
  const model::PlanarArm plane = test::planarArm();
  const model::Arm arm = model::embed(plane);
  const Load down = weightIn(-Eigen::Vector3d::UnitY()),
             across = weightIn(Eigen::Vector3d::UnitZ());
  const ArmModel model(arm, plane, down);
  EXPECT_EQ(model.choice().setting.tier, Tier::kLoaded);
  const Solution found = model.solve(arm.inputAt(0.4));
  ASSERT_TRUE(found.converged());
  const Solution truth = ExactArm(arm, down).solve(arm.twists(arm.inputAt(0.4)));
  EXPECT_LT((found.tip.translation - truth.tip.translation).norm(), 1e-3 * arm.restLength(0));
  EXPECT_EQ(found.tip.translation.z(), 0.0);
  EXPECT_EQ(chooseTier(arm, plane, down, request(Tier::kPlanar)).setting.tier, Tier::kPlanar);
  EXPECT_EQ(chooseTier(arm, plane, across, {}).setting.tier, Tier::kLoaded);
}

// Upright and top-heavy, it falls out of its plane: what keeps it there must not be assumed.
TEST(TierChoice, APlanarArmThatMayBuckleOutOfItsPlaneIsSolvedInSpace) {
  const model::PlanarArm plane = test::planarArm();
  const model::Arm arm = model::embed(plane);
  Load load = weightIn(-Eigen::Vector3d::UnitX());
  EXPECT_TRUE(staysInPlane(arm, weightIn(-Eigen::Vector3d::UnitY())));
  load.points.resize(1);
  load.points[0].mass = 1.0;
  ASSERT_TRUE(inPlane(load));
  EXPECT_FALSE(staysInPlane(arm, load));
  for (const int order : {2, 5, 8}) {
    TierRequest by_order = request(Tier::kLoaded, order);
    try {
      const ArmModel model(arm, plane, load, by_order);
      EXPECT_FALSE(model.solve(arm.inputAt(0.0)).converged()) << order;
    } catch (const std::invalid_argument& error) {
      EXPECT_NE(std::string(error.what()).find("no shape balances it"), std::string::npos);
    }
  }
}

// What chooseTier() promises of an accuracy and of a time, at inputs that it has not sampled.

using Eigen::VectorXd;

// Uniform within the limits, at random corners of them, and where every section's twist is farthest
// out in a random direction: no one of these is a sample of the choice.
VectorXd unseenInput(const model::Arm& arm, int kind, test::Random& random) {
  VectorXd fraction(arm.actuatorCount());
  for (double& one : fraction) one = kind == 0 ? random.uniform(0, 1) : random.integer(0, 1);
  for (int k = 0; k < arm.sectionCount() && kind == 2; ++k) {
    lie::Vector6 direction = random.direction<6>();
    direction.head<3>() /= arm.freeLength(k);
    const VectorXd lengthening = arm.equilibrium(k).map.transpose() * direction;
    fraction.segment(arm.firstActuator(k), lengthening.size()) =
        (lengthening.array() < 0).cast<double>();
  }
  return arm.inputAt(fraction);
}

TEST(TierPromise, RandomScenesKeepTheAccuracyThatIsAskedFor) {
  const int scenes = test::draws(12, 50);
  test::Random random(53);
  int by_order[kMostOrder + 1] = {}, exact_ones = 0;
  for (int scene = 0; scene < scenes; ++scene) {
    const int sections = 1 + scene % 4;
    const model::Arm arm = randomRings(sections, {1, 24}, 1e-5, random);
    Load load = test::randomLoad(sections, random);
    const double heavier = random.uniform(0.3, 1.2);
    for (double& mass : load.mass) mass *= heavier;
    TierRequest request;
    request.relative_tip_error = random.logUniform(1e-8, 1e-3);
    const ArmModel model(arm, std::nullopt, load, request);
    const TierSetting setting = model.choice().setting;
    if (setting.tier == Tier::kLoaded) ++by_order[setting.order];
    if (setting.tier == Tier::kExact) {
      ++exact_ones;
      continue;
    }
    const ExactArm exact(arm, load);
    for (int i = 0; i < 42; ++i) {
      const VectorXd q = unseenInput(arm, i % 3, random);
      const Tip found = model.tip(q);
      const Solution truth = exact.solve(arm.twists(q));
      if (!found.converged() || !truth.converged()) continue;
      const double error =
          (found.tip.translation - truth.tip.translation).norm() / arm.restLength();
      EXPECT_LE(error, *request.relative_tip_error)
          << "scene " << scene << ", " << setting.name() << ", input " << i;
    }
  }
  EXPECT_LT(exact_ones, 3 * scenes / 10);
  EXPECT_GT(by_order[2] + by_order[3], test::draws(0, 5));
  EXPECT_GT(by_order[4] + by_order[5] + by_order[6], test::draws(0, 5));
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

}  // namespace
}  // namespace helix_arm::statics
