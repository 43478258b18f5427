// Loaded arms at the ends of their parameters, against the exact tier.
#include <algorithm>
#include <cmath>
#include <limits>
#include <string>
#include <tuple>

#include "extremes/extreme_arm.hpp"
#include "extremes/family.hpp"
#include "helix_arm/model/curve.hpp"
#include "helix_arm/statics/arm_model.hpp"
#include "helix_arm/statics/exact.hpp"
#include "helix_arm/statics/loaded.hpp"
#include "support/loaded_arm.hpp"

namespace helix_arm::statics {
namespace {

using Eigen::Vector3d;
using namespace test;

const double kDenormal = std::numeric_limits<double>::denorm_min();

// Weight and a tip load that bend the arm by about 0.3 rad, or stretch or shear it by a tenth.
Load fittingLoad(const model::Arm& arm, test::Random& random) {
  constexpr double kStiffness = 1000.0, kBend = 0.3, kStretch = 0.1;
  double bend = 0, stretch = 0;
  const double length = arm.restLength();
  for (int k = 0; k < arm.sectionCount(); ++k) {
    const lie::Matrix6 C = arm.freeLength(k) / kStiffness * arm.equilibrium(k).compliance;
    bend += C.bottomRightCorner<3, 3>().norm();
    stretch += C.topLeftCorner<3, 3>().norm();
  }
  const double force = std::min(kBend / (bend * length), kStretch * length / stretch);
  Load load = test::evenLoad(arm.sectionCount(), test::kGravity * random.direction<3>(),
                             force / test::kGravity / arm.sectionCount(), kStiffness);
  PointLoad tip{arm.sectionCount() - 1};
  tip.force = 0.3 * force * random.direction<3>();
  tip.moment = 0.1 * force * length * random.direction<3>();
  load.points = {tip};
  return load;
}

double largestTurnOf(const model::Twists& twists) {
  return twists.bottomRows<3>().colwise().norm().maxCoeff();
}

TEST(Extremes, LoadedArmsAgreeWithTheExactOnes) {
  constexpr double kMostTurn = 2 * test::kPi;  // of a section, that order 8 is meant for
  for (const BuildFamily& family : test::extremeBuilds()) {
    Family tips(std::string("order 8, ") + family.range, 1e-7, "of the length");
    test::Random random(802);
    int curled = 0, refused = 0, moved = 0;
    for (const Build& build : family.builds) {
      const model::Arm arm = build.arm();
      const Load load = fittingLoad(arm, random);
      const ExactArm exact(arm, load);
      const LoadedArm loaded(arm, load, kMostOrder);
      for (int i = 0; i < 3; ++i) {
        const model::Twists twists = arm.twists(test::randomInput(arm, random));
        if (largestTurnOf(twists) > kMostTurn) {
          ++curled;
          continue;
        }
        const Solution truth = exact.solve(twists), found = loaded.solve(twists);
        EXPECT_TRUE(truth.converged()) << build.name();
        refused += !found.converged();
        if (!truth.converged() || !found.converged()) continue;
        const double length = arm.restLength();
        moved +=
            (truth.tip.translation - model::tipPose(twists).translation).norm() > 1e-3 * length;
        tips.add((found.tip.translation - truth.tip.translation).norm() / length, build.name());
        EXPECT_LT((tipPose(found.shape).translation - found.tip.translation).norm(), 1e-9 * length);
      }
    }
    std::printf("  %d curl up too far, %d refused, %d moved by more than 0.1 %%\n", curled, refused,
                moved);
    EXPECT_GT(moved, tips.cases() / 2) << family.range;
    EXPECT_LT(refused, tips.cases() / 4) << family.range;
  }
}

TEST(Extremes, DenormalLoadsAreNone) {
  Family family("denormal loads", 1e-12, "of the length");
  for (const int sections : {1, 3}) {
    const model::Arm arm = test::ringArm(test::helicalRing(), sections);
    const model::Twists twists = arm.twists(arm.inputAt(0.3));
    const lie::SE3 unloaded = model::tipPose(twists);
    for (const double value : {kDenormal, 1e-310, 3e-308}) {
      for (int kind = 0; kind < 5; ++kind) {
        Load load = test::evenLoad(sections, {0, 0, kind == 1 ? value : 9.81},
                                   kind == 0   ? value
                                   : kind == 1 ? 0.2
                                               : 0.0,
                                   1000.0);
        PointLoad tip{sections - 1};
        if (kind == 2) tip.force = Vector3d::Constant(value);
        if (kind == 3) tip.moment = Vector3d::Constant(value);
        if (kind == 4) tip.mass = value;
        tip.offset = Vector3d::Constant(value);
        load.points = {tip};
        const std::string place = text("%g, kind %d, %d sections", value, kind, sections);
        const Solution truth = ExactArm(arm, load).solve(twists);
        EXPECT_TRUE(truth.converged()) << place;
        EXPECT_LE(truth.iterations, 3) << place;
        family.add((truth.tip.translation - unloaded.translation).norm() / arm.restLength(), place);
        for (int order = kLeastOrder; order <= kMostOrder; ++order) {
          const Solution found = LoadedArm(arm, load, order).solve(twists);
          EXPECT_TRUE(found.converged()) << place;
          EXPECT_LE(found.iterations, 3) << place;
          EXPECT_TRUE(found.shape.pieces().allFinite()) << place;
          family.add((found.tip.translation - unloaded.translation).norm() / arm.restLength(),
                     place);
        }
        EXPECT_EQ(chooseTier(arm, std::nullopt, load, {}).setting.tier, Tier::kLinear) << place;
      }
    }
  }
}

// A column along x that hardly shortens or shears, pressed at its tip or by its own weight: Euler
// and Greenhill say where the exact tier's shape leaves the axis, and orders find that shape or say
// that they did not.
TEST(Buckling, ColumnsGiveWayAtTheirCriticalLoadsAndTiersFindTheStableShapeOrSayThatTheyDidNot) {
  const test::Ring ring{3, 1e-3, 0.0, {1e4, 1e-5, 1e-5}};
  constexpr double kEps_N = 1000.0;  // K_eps
  ExactOptions patient;              // from straight to bent is a sharp turn
  patient.max_iterations = 500;
  test::Random random(801);
  for (const auto& [name, by_weight, sections] :
       {std::tuple{"pressed at its tip", false, 1},
        {"under its own weight", true, 1},
        {"of 3 sections, under its own weight", true, 3}}) {
    const model::Arm arm = test::ringArm(ring, sections);
    const model::Twists straight = arm.twists(arm.inputAt(0));
    const double length = sections * arm.freeLength(0);
    const double EI = kEps_N * 3 * (ring.stiffness.kappa + 0.5 * ring.radius * ring.radius);
    const double critical =
        (by_weight ? 7.837 : test::kPi * test::kPi / 4) * EI / (length * length);
    int found_under = 0, refused_past = 0;
    for (const double share : {0.5, 0.8, 0.95, 0.99, 1.01, 1.05, 1.2, 1.5, 2.0}) {
      const double force = share * critical, angle = random.uniform(0, 2 * test::kPi);
      Load load = test::evenLoad(sections, {-test::kGravity, 0, 0},
                                 by_weight ? force / test::kGravity / sections : 0.0, kEps_N);
      load.points.assign(1, PointLoad{sections - 1});
      load.points[0].force =
          force * Vector3d(by_weight ? 0 : -1, 1e-4 * std::cos(angle), 1e-4 * std::sin(angle));
      const Solution truth = ExactArm(arm, load, patient).solve(straight);
      ASSERT_TRUE(truth.converged()) << name << " " << share;
      const double swing = truth.tip.translation.tail<2>().norm() / arm.restLength();
      EXPECT_TRUE(share < 1 ? swing < 0.05 : swing > 0.1) << name << " " << share << ": " << swing;
      for (int order = kLeastOrder; order <= kMostOrder; ++order) {
        const Solution found = LoadedArm(arm, load, order).solve(straight);
        found_under += share < 1 && found.converged();
        refused_past += share > 1 && !found.converged();
        const double off = (found.tip.translation - truth.tip.translation).norm();
        EXPECT_TRUE(!found.converged() || off < 1e-2 * arm.restLength()) << order << " " << share;
      }
    }
    EXPECT_GT(found_under, 21) << name << ": of 4 shares in 7 orders";
    EXPECT_GT(refused_past, 0) << name;
  }
}

}  // namespace
}  // namespace helix_arm::statics
