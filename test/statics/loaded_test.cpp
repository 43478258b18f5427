#include "helix_arm/statics/loaded.hpp"

#include <gtest/gtest.h>

#include "helix_arm/model/curve.hpp"
#include "helix_arm/statics/exact.hpp"
#include "helix_arm/statics/stiffness_by_input.hpp"
#include "statics/arms_under_load.hpp"
#include "support/allocation_counter.hpp"

namespace helix_arm::statics {
namespace {

using test::Posture;

TEST(Loaded, AgreesWithShootingOnArmsOfEveryKind) {
  struct Case {
    const char* name;
    model::Arm arm;
    Load load;
    std::vector<std::pair<int, double>> bounds;  // by orders, of the arm's length
    double moved;                                // by the load, at least [m]
  };
  const std::vector<std::pair<int, double>> stated{{2, statedTipError(2)}, {3, statedTipError(3)}};
  const auto and_then = [&stated](std::pair<int, double> a, std::pair<int, double> b) {
    auto out = stated;
    out.push_back(a);
    out.push_back(b);
    return out;
  };
  Load knots = weightless(2, 900);
  knots.gravity = {3, -2, -8};
  knots.mass = {0.1, 0.05};
  knots.K_eps = {900, 700};
  knots.points = {{0, 0.7, 0.02}};
  const Load weight = test::weight(Posture::kHorizontal, 0.15, 900);
  const Case cases[] = {
      {"plates and a tool", test::linkedArm(), spatialLoad(test::linkedArm()),
       and_then({5, statedTipError(5)}, {8, 1e-7}), 2e-3},
      {"taper", test::taperedArm(), weight, and_then({5, 1e-5}, {8, 1e-5}), 5e-4},
      {"tilted taper", test::taperedArm(kTilt), weight, and_then({5, 1e-5}, {8, 1e-5}), 5e-4},
      // Where a list changes its slope the strain has a kink, and orders gain less.
      {"knots", twoTaperedSections(), knots, {{5, 1e-4}, {8, 2e-5}}, 1e-3},
      {"table of stiffness", test::softHelicalArm(), loadWith(kTable), {{6, 1e-5}}, 1e-3},
  };
  test::Random random(81);
  for (const Case& one : cases) {
    const ExactArm exact(one.arm, one.load);
    for (int i = 0; i < 10; ++i) {
      const model::Unloaded unloaded =
          unloadedUnder(one.arm, one.load, test::randomInput(one.arm, random));
      const Solution truth = exact.solve(unloaded);
      ASSERT_TRUE(truth.converged()) << one.name;
      EXPECT_LT(apart(model::tipPose(truth.shape), truth.tip), 1e-9) << one.name;
      const lie::SE3 rest = model::tipPose(shapeOf(one.arm, unloaded));
      EXPECT_GT((truth.tip.translation - rest.translation).norm(), one.moved) << one.name;
      for (const auto& [order, bound] : one.bounds) {
        const Solution found = LoadedArm(one.arm, one.load, order).solve(unloaded);
        ASSERT_TRUE(found.converged()) << one.name << order;
        const double off = (found.tip.translation - truth.tip.translation).norm();
        EXPECT_LT(off, bound * one.arm.restLength()) << one.name << order;
        EXPECT_LT(apart(model::tipPose(found.shape), found.tip), 1e-9) << one.name << order;
      }
      const auto curve = LoadedArm(one.arm, one.load, 5).curve(unloaded, 11);
      const auto expected = exact.curve(unloaded, 11);
      for (int k = 0; k < 11; ++k) EXPECT_LT(apart(curve[k].X, expected[k].X), 1e-3) << one.name;
    }
  }
}

Load planarLoad() {
  Load load;
  load.gravity = {3.0, -9.0, 0};
  load.mass = {0.1, 0.1};
  load.K_eps = {900, 1100};
  load.points = {{0, 0.4, 0.02, {0, 0.1, 0}, {0, 0, 0.01}, {0.01, -0.02, 0}}, {1, 1.0, 0.03}};
  return load;
}

TEST(Loaded, ThePlaneAndSpaceAgreeOnPlanarArms) {
  const model::PlanarArm linked = test::linkedPlanarArm();
  Load table = loadWith(kTable);
  table.gravity = {1, -9, 0};
  Load weight = test::weight(Posture::kHanging, 0.15, 900);
  weight.gravity = {2, -9, 0};
  const struct {
    model::PlanarArm plane;
    Load load;
    double tolerance, moved;
  } cases[] = {{test::planarArm(2), planarLoad(), 1e-9, 1e-3},
               {linked, loadOfLinks(model::embed(linked), {3, -8, 0}, {0.05, 0.1, 0}), 1e-9, 1e-3},
               {test::taperedPlanarArm(), weight, 1e-8, 1e-3},
               {test::planarArm(), table, 1e-8, 1e-3}};
  test::Random random(11);
  for (const auto& [plane, load, tolerance, moved] : cases) {
    const model::Arm space = model::embed(plane);
    ASSERT_TRUE(inPlane(load));
    for (int i = 0; i < 30; ++i) {
      const Eigen::VectorXd q = test::randomInput(space, random);
      const model::Unloaded unloaded = unloadedUnder(space, load, q);
      for (const int order : {2, 5, 8}) {
        const Solution flat =
            PlanarLoadedArm(plane, load, order).solve(unloadedUnder(plane, load, q));
        const Solution found = LoadedArm(space, load, order).solve(unloaded);
        ASSERT_TRUE(flat.converged() && found.converged());
        EXPECT_LT((flat.tip.translation - found.tip.translation).norm(), 0.1 * tolerance);
        EXPECT_LT(apart(flat.tip, found.tip), tolerance);
        EXPECT_LT((flat.shape.twists() - found.shape.twists()).norm(), 1e-8);
        EXPECT_LT(apart(model::tipPose(flat.shape), flat.tip), 1e-9);
        EXPECT_GT((flat.tip.translation - space.tip(q).translation).norm(), moved);
      }
    }
  }
}

TEST(Loaded, KnowsLoadsThatLeaveThePlane) {
  EXPECT_TRUE(inPlane(planarLoad()));
  for (const auto& leave :
       std::vector<void (*)(Load&)>{[](Load& across) { across.gravity.z() = 1e-3; },
                                    [](Load& across) { across.points[0].force.z() = 1e-3; },
                                    [](Load& across) { across.points[0].moment.x() = 1e-3; },
                                    [](Load& across) { across.points[0].offset.z() = 1e-3; }}) {
    Load across = planarLoad();
    leave(across);
    EXPECT_FALSE(inPlane(across));
  }
}

// Exactly straight, so that nothing tells the column which way to go: the straight shape balances
// the load, but does not hold.
TEST(Loaded, APerfectColumnPastItsLoadIsNotCalledBalanced) {
  const model::Arm arm = test::ringArm(test::straightRing());
  const model::Twists twists = arm.twists(arm.inputAt(0.0));
  for (const auto& [mass, holds] : {std::pair{0.02, true}, std::pair{6.0, false}}) {
    Load load = test::evenLoad(1, {-test::kGravity, 0, 0}, 0.0, 500);
    load.points = {{0, 1.0, mass}};
    EXPECT_EQ(ExactArm(arm, load).solve(twists).converged(), holds) << mass;
    for (int order = kLeastOrder; order <= kMostOrder; ++order) {
      EXPECT_EQ(LoadedArm(arm, load, order).solve(twists).converged(), holds)
          << mass << " " << order;
    }
  }
}

TEST(Loaded, FindsTheTipWithoutTheHeap) {
  const model::Arm arm = test::softHelicalArm();
  const LoadedArm loaded(arm, test::weight(Posture::kHorizontal, 0.2, 800), 5);
  // Near buckling the least order is compared with a finer one.
  test::Ring ring = test::straightRing();
  ring.stiffness.tau = 1e-4;
  Load load = test::weight(Posture::kHanging, 0.0, 900);
  load.points = {{0, 1.0, 0.0, {-16.75, 0, 0.01}}};
  const model::Arm slender = test::ringArm(ring);
  const LoadedArm compared(slender, load, kLeastOrder);
  const model::Twists twists = arm.twists(arm.inputAt(0.3)),
                      rest = slender.twists(slender.inputAt(0.0));
  const lie::SE3 once = loaded.tip(twists).tip;
  ASSERT_FALSE(compared.tip(rest).converged());
  const test::AllocationCounter counter;
  const lie::SE3 tip = loaded.tip(twists).tip;
  compared.tip(rest);
  EXPECT_EQ(counter.count(), 0u);
  EXPECT_EQ(tip.translation, once.translation);
}

}  // namespace
}  // namespace helix_arm::statics
