#include "helix_arm/statics/tier.hpp"

#include <algorithm>
#include <cstdio>
#include <string>

#include <gtest/gtest.h>

#include "helix_arm/model/curve.hpp"
#include "helix_arm/statics/arm_model.hpp"
#include "helix_arm/statics/correction.hpp"
#include "helix_arm/statics/exact.hpp"
#include "helix_arm/statics/inverse.hpp"
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

TierRequest within(double relative_tip_error) {
  TierRequest request;
  request.relative_tip_error = relative_tip_error;
  return request;
}
std::string refusal(const model::Arm& arm, const std::optional<model::PlanarArm>& planar,
                    const std::optional<Load>& load, const TierRequest& wanted) {
  return test::refusal([&] { chooseTier(arm, planar, load, wanted); });
}

TEST(TierChoice, WithoutLoadTheClosedFormsServe) {
  const model::Arm arm = test::softHelicalArm();
  EXPECT_EQ(chooseTier(arm, {}, {}, {}).setting.tier, Tier::kLinear);
  EXPECT_EQ(chooseTier(arm, {}, {}, within(1e-8)).setting.tier, Tier::kLinear);
  EXPECT_EQ(chooseTier(model::embed(test::planarArm()), test::planarArm(), {}, {}).setting.tier,
            Tier::kPlanar);
  EXPECT_EQ(
      chooseTier(model::embed(test::planarArm()), test::planarArm(), {}, request(Tier::kLinear))
          .setting.tier,
      Tier::kLinear);
  const Load weightless = weightIn(Eigen::Vector3d::Zero());
  EXPECT_EQ(chooseTier(arm, {}, weightless, {}).setting.tier, Tier::kLinear);
  EXPECT_EQ(chooseTier(arm, {}, weightless, request(Tier::kLinear)).reason,
            chooseTier(arm, {}, {}, request(Tier::kLinear)).reason);
  EXPECT_EQ(chooseTier(arm, {}, weightless, request(Tier::kExact)).setting.tier, Tier::kExact);
}

TEST(TierChoice, MoreAccuracyIsNeverCheaper) {
  const model::Arm arm = test::softHelicalArm();
  const Load load = weightIn(-Eigen::Vector3d::UnitZ());
  int last_order = -1;
  for (const double allowed : {0.5, 1e-2, 1e-4, 1e-6, 1e-8}) {
    const int order = chooseTier(arm, {}, load, within(allowed)).setting.order;
    EXPECT_GE(order, last_order);
    last_order = order;
  }
  EXPECT_EQ(chooseTier(arm, {}, load, within(0.5)).setting.tier, Tier::kLinear);
  EXPECT_EQ(chooseTier(arm, {}, load, {}).setting.tier, Tier::kLoaded);
  EXPECT_GT(last_order, 5);
}

TEST(TierChoice, ATimeBuysTheMostAccurateTierThatKeepsIt) {
  const model::Arm arm = test::softHelicalArm();
  const Load load = weightIn(-Eigen::Vector3d::UnitZ());
  TierRequest by_time;
  by_time.time = 1.0;
  EXPECT_LE(chooseTier(arm, {}, load, by_time).relative_tip_error, 1e-9);
  by_time.time = 1e-12;
  EXPECT_NE(refusal(arm, {}, load, by_time).find("budget.time_us"), std::string::npos);
  EXPECT_NE(refusal(arm, {}, {}, by_time).find("budget.time_us"), std::string::npos);
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

TEST(TierChoice, ManyPlacesInsideSectionsAreLeftToTheExactTier) {
  const model::Arm arm = test::softHelicalArm();
  Load load = weightIn(Eigen::Vector3d::UnitZ());
  for (int i = 1; i <= kMaxInnerPoints + 1; ++i) {
    load.points.push_back({});
    load.points.back().s = i / (kMaxInnerPoints + 2.0);
    load.points.back().mass = 0.001;
  }
  EXPECT_EQ(chooseTier(arm, {}, load, {}).setting.tier, Tier::kExact);
  const std::string message = refusal(arm, {}, load, request(Tier::kLoaded, 5));
  EXPECT_EQ(message.find("load.points"), 0u) << message;
  EXPECT_TRUE(test::has(message, "tier: exact"));
}

TEST(TierChoice, NamesTheKeyAndTheRemedyOfWhatItRefuses) {
  const model::PlanarArm plane = test::planarArm();
  const model::Arm arm = test::softHelicalArm();
  const Load load = weightIn(Eigen::Vector3d::UnitZ());
  const auto expect = [](const std::string& message, const char* key, const char* remedy) {
    EXPECT_EQ(message.find(key), 0u) << message;
    EXPECT_TRUE(test::has(message, remedy));
  };
  expect(refusal(arm, {}, {}, request(Tier::kPlanar)), "tier: planar", "use tier: linear");
  expect(refusal(model::embed(plane), plane, load, request(Tier::kPlanar)), "tier: planar",
         "use tier: loaded");
  expect(refusal(arm, {}, {}, request(Tier::kLoaded)), "tier: loaded", "the key load");
  expect(refusal(arm, {}, {}, request(Tier::kExact)), "tier: exact", "the key load");
  expect(refusal(arm, {}, load, within(1e-12)), "accuracy.tip_error_percent", "allow that or more");
  TierRequest linear = request(Tier::kLinear);
  linear.relative_tip_error = 1e-4;
  expect(refusal(arm, {}, load, linear), "accuracy.tip_error_percent", "use tier: auto");
  expect(refusal(arm, {}, load, request(Tier::kLoaded, 9)), "order", "2 to 8");
  expect(refusal(arm, {}, load, request(Tier::kExact, 5)), "order", "tier: loaded");
  TierRequest both = within(1e-3);
  both.time = 1e-3;
  expect(refusal(arm, {}, load, both), "accuracy and budget", "one of them");
  Load crushing = load;
  crushing.mass = {1e6};
  expect(refusal(arm, {}, crushing, {}), "load", "lower the masses");
}

TEST(ArmModel, EveryTierGivesTheShapeOfItsTip) {
  const model::PlanarArm plane = test::planarArm();
  const Load load = weightIn(-Eigen::Vector3d::UnitY());
  for (const Tier tier : {Tier::kPlanar, Tier::kLinear, Tier::kLoaded, Tier::kExact}) {
    const ArmModel model(model::embed(plane), plane, load, request(tier));
    const Eigen::VectorXd q = model.arm().inputAt(0.7);
    const Solution solution = model.solve(q);
    EXPECT_LT((model::tipPose(solution.shape).translation - solution.tip.translation).norm(),
              1e-10);
    EXPECT_LT((model.tip(q).tip.translation - solution.tip.translation).norm(), 1e-12);
    // Copies solve on their own.
    const ArmModel copy = model;
    EXPECT_EQ(copy.solve(q).tip.translation, solution.tip.translation);
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
  double closest = 0.0;
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
      closest = std::max(closest, error / *request.relative_tip_error);
    }
  }
  std::printf("exact %d, orders 2 to 8:", exact_ones);
  for (int order = kLeastOrder; order <= kMostOrder; ++order) std::printf(" %d", by_order[order]);
  std::printf("; largest error %.2f of what is allowed\n", closest);
  EXPECT_LT(exact_ones, 3 * scenes / 10);
  EXPECT_GT(by_order[2] + by_order[3], test::draws(0, 5));
  EXPECT_GT(by_order[4] + by_order[5] + by_order[6], test::draws(0, 5));
}

// ---- Tapered sections, plates and tools in every tier -------------------------------------------

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

// Of a tapered arm, one with a plate and a tool, and one of two sections with links, as it is and
// loaded.
TEST(LoadedLinks, TheInverseCloses) {
  const model::Arm linked = test::linkedArm();
  model::Section section = test::ringSection(test::straightRing(), test::fig3Muscle());
  section.plate = 0.02;
  test::Random random(84);
  for (const ArmModel& model :
       {ArmModel(test::taperedArm(kTilt)), ArmModel(model::Arm({section}, test::tool())),
        ArmModel(linked),
        ArmModel(linked, std::nullopt, spatialLoad(linked), TierSetting{Tier::kLoaded, 3})}) {
    InverseSolver solver(model);
    const Eigen::VectorXd start = model.arm().inputAt(0.5);
    for (int i = 0; i < 5; ++i) {
      const lie::SE3 wanted = model.tip(test::randomInput(model.arm(), random)).tip;
      const InverseResult& found = solver.toPosition(wanted.translation, start);
      EXPECT_EQ(found.status, InverseStatus::kReached);
      EXPECT_LT((model.tip(found.input).tip.translation - wanted.translation).norm(), 1e-5);
      if (model.arm().actuatorCount() < 6) continue;
      const InverseResult& pose = solver.toPose(wanted, start);
      EXPECT_EQ(pose.status, InverseStatus::kReached);
      EXPECT_LT(apart(model.tip(pose.input).tip, wanted), 1e-4);
    }
  }
}

}  // namespace
}  // namespace helix_arm::statics
