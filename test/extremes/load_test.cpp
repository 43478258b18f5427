// Loaded arms at the ends of their parameters, against the exact tier.
#include <algorithm>
#include <cmath>
#include <limits>

#include "extremes/extreme_arm.hpp"
#include "extremes/family.hpp"
#include "helix_arm/model/curve.hpp"
#include "helix_arm/statics/arm_model.hpp"
#include "helix_arm/statics/exact.hpp"
#include "helix_arm/statics/inverse.hpp"
#include "helix_arm/statics/loaded.hpp"
#include "support/allocation_counter.hpp"
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
  Load load;
  load.gravity = test::kGravity * random.direction<3>();
  load.mass.assign(arm.sectionCount(), force / test::kGravity / arm.sectionCount());
  load.K_eps.assign(arm.sectionCount(), kStiffness);
  PointLoad tip;
  tip.section = arm.sectionCount() - 1;
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

TEST(Extremes, TheChosenTierKeepsItsAccuracy) {
  for (const BuildFamily& family : test::extremeBuilds()) {
    Family tips(std::string("tier auto, ") + family.range, kUsualTipError, "of the length");
    test::Random random(803);
    for (std::size_t b = 0; b < family.builds.size(); b += 3) {
      const Build& build = family.builds[b];
      if (build.sections > 8) continue;
      const model::Arm arm = build.arm();
      const Load load = fittingLoad(arm, random);
      const ArmModel model(arm, std::nullopt, load);
      const ExactArm exact(arm, load);
      for (int i = 0; i < 5; ++i) {
        const Eigen::VectorXd q = test::randomInput(arm, random);
        const Solution truth = exact.solve(arm.twists(q));
        const Tip found = model.tip(q);
        EXPECT_TRUE(truth.converged() && found.converged()) << build.name();
        tips.add((found.tip.translation - truth.tip.translation).norm() / arm.restLength(),
                 model.choice().setting.name() + ", " + build.name());
      }
    }
  }
}

TEST(Extremes, LoadedInverseFindsWhatForwardReached) {
  constexpr int kMostActuators = 6;
  TierRequest request;
  request.tier = Tier::kLoaded;
  request.order = 4;
  for (const BuildFamily& family : test::extremeBuilds()) {
    test::Random random(805);
    std::vector<const Build*> builds;
    for (const Build& build : family.builds) {
      if (build.sections * build.ring.count <= kMostActuators) builds.push_back(&build);
    }
    if (builds.empty()) continue;
    Family near(std::string("loaded inverse, ") + family.range, 1.0, "of the tolerance");
    for (const Build* build : builds) {
      const model::Arm arm = build->arm();
      const ArmModel model(arm, std::nullopt, fittingLoad(arm, random), request);
      InverseOptions options;
      options.position_tolerance = 1e-6 * arm.restLength();
      options.rotation_weight = 0.1 * arm.restLength();
      InverseSolver solver(model, options);
      for (int i = 0; i < 3; ++i) {
        const Eigen::VectorXd q = test::randomInput(arm, random);
        if (largestTurnOf(arm.twists(q)) > 2 * test::kPi) continue;
        const Vector3d target = model.tip(q).tip.translation;
        const InverseResult& result = solver.toPosition(target, arm.inputAt(0.2));
        EXPECT_EQ(result.status, InverseStatus::kReached) << build->name();
        near.add(
            (model.tip(result.input).tip.translation - target).norm() / options.position_tolerance,
            build->name());
      }
    }
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
        Load load;
        load.mass.assign(sections, kind == 0 ? value : 0.0);
        load.K_eps.assign(sections, 1000.0);
        load.gravity = {0, 0, kind == 1 ? value : 9.81};
        if (kind == 1) load.mass.assign(sections, 0.2);
        PointLoad tip;
        tip.section = sections - 1;
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

TEST(Extremes, DenormalsInALoadedTwistAreZeros) {
  Family family("denormals in loaded twists", 1e-12, "of the length");
  const model::Arm arm = test::softHelicalArm();
  const Load load = test::weight(test::Posture::kHorizontal, 0.2, 900);
  for (int axis = 1; axis < 6; ++axis) {
    model::Twists clean = model::Twists::Zero(6, 1);
    clean(0, 0) = 0.43;
    model::Twists twists = clean;
    twists(axis, 0) = kDenormal;
    for (int order = kLeastOrder; order <= kMostOrder; ++order) {
      const LoadedArm loaded(arm, load, order);
      const Solution expected = loaded.solve(clean), found = loaded.solve(twists);
      ASSERT_TRUE(found.converged() && expected.converged());
      EXPECT_LE(found.iterations, expected.iterations + 1);
      family.add((found.tip.translation - expected.tip.translation).norm() / 0.43,
                 text("order %d, entry %d", order, axis));
    }
    const ExactArm exact(arm, load);
    family.add(
        (exact.solve(twists).tip.translation - exact.solve(clean).tip.translation).norm() / 0.43,
        text("exact, entry %d", axis));
  }
}

TEST(Extremes, LoadsFromNothingToPastWhatTheArmCarries) {
  Family family("loads 1e-12 to 1e3 of what bends the arm", 1e-6, "of the length");
  test::Random random(804);
  int balanced = 0, refused = 0, past = 0;
  for (int i = 0; i < 300; ++i) {
    const model::Arm arm =
        test::ringArm(i % 2 ? test::helicalRing() : test::straightRing(), 1 + i % 3);
    const double share = random.logUniform(1e-12, 1e3);
    Load load = fittingLoad(arm, random);
    load.gravity *= share;
    load.points[0].force *= share;
    load.points[0].moment *= share;
    const model::Twists twists = arm.twists(test::randomInput(arm, random));
    const Solution truth = ExactArm(arm, load).solve(twists);
    const Solution found = LoadedArm(arm, load, kMostOrder).solve(twists);
    past += share > 30;
    EXPECT_TRUE(found.tip.translation.allFinite() && found.shape.pieces().allFinite());
    EXPECT_FALSE(std::isnan(found.residual));
    if (share < 1) {
      EXPECT_TRUE(found.converged() && truth.converged()) << share;
    }
    (found.converged() ? balanced : refused)++;
    if (!truth.converged() || !found.converged()) continue;
    family.add((found.tip.translation - truth.tip.translation).norm() / arm.restLength(),
               text("%.3g of it, %d sections", share, arm.sectionCount()));
  }
  std::printf("  %d balanced, %d refused\n", balanced, refused);
  EXPECT_GT(past, 20);
  EXPECT_GT(balanced, 200);
  EXPECT_GT(refused, 10);
}

// Columns under, at and past the load that buckles them: the loaded tier finds the shape that the
// exact one finds, or says that it did not.
constexpr double kEps_N = 1000.0;  // K_eps

// A thin column along x that hardly shortens or shears: bending is softer by 1e3 and more.
test::Ring thinRing() { return {3, 1e-3, 0.0, {1e4, 1e-5, 1e-5}}; }

// Bending stiffness of the ring by hand [N m^2].
double bendingOf(const test::Ring& ring) {
  return kEps_N * ring.count * (ring.stiffness.kappa + 0.5 * ring.radius * ring.radius);
}

// Euler's load of a column that is held at its base and free at its tip [N].
double eulerLoad(const model::Arm& arm, const test::Ring& ring) {
  double l = 0;
  for (int k = 0; k < arm.sectionCount(); ++k) l += arm.freeLength(k);
  return test::kPi * test::kPi / 4 * bendingOf(ring) / (l * l);
}

Load pressed(const model::Arm& arm, double force, const Vector3d& aside) {
  Load load;
  load.mass.assign(arm.sectionCount(), 0.0);
  load.K_eps.assign(arm.sectionCount(), kEps_N);
  PointLoad tip;
  tip.section = arm.sectionCount() - 1;
  tip.force = Vector3d(-force, 0, 0) + aside;
  load.points = {tip};
  return load;
}

// How far the tip of the arm leaves its axis, by its length.
double swingOf(const Solution& solution, double length) {
  return solution.tip.translation.tail<2>().norm() / length;
}

constexpr double kShares[] = {0.1, 0.5, 0.8, 0.95, 0.99, 1.01, 1.05,
                              1.2, 1.5, 2.0, 3.0,  5.0,  8.0,  12.0};
constexpr double kImperfections[] = {1e-8, 1e-6, 1e-4, 1e-2};

// A column under a load that is some share of the one that buckles it.
struct Column {
  const char* name;
  test::Ring ring;
  int sections;
  bool by_its_weight;
  // The largest share that is safely below the load and the smallest above it: Euler's load assumes
  // a column without shortening and shear.
  double under, past;

  model::Arm arm() const { return test::ringArm(ring, sections); }
  double critical() const {
    return (by_its_weight ? 7.837 / 2.4674 : 1.0) * eulerLoad(arm(), ring);
  }
  // @param aside  force at the tip, as a part of the load.
  Load load(double share, double aside, double angle) const {
    const double force = share * critical();
    const Vector3d across = aside * force * Vector3d(0, std::cos(angle), std::sin(angle));
    if (!by_its_weight) return pressed(arm(), force, across);
    Load load = pressed(arm(), 0, across);
    load.gravity = {-9.81, 0, 0};
    load.mass.assign(sections, force / 9.81 / sections);
    return load;
  }
};

std::vector<Column> columns() {
  return {{"pressed at its tip", thinRing(), 1, false, 0.99, 1.01},
          {"of 3 sections, pressed at its tip", thinRing(), 3, false, 0.99, 1.01},
          {"thick, pressed at its tip", test::straightRing(), 1, false, 0.95, 1.05},
          {"under its own weight", thinRing(), 1, true, 0.99, 1.01},
          {"of 3 sections, under its own weight", thinRing(), 3, true, 0.99, 1.01}};
}

// The exact tier, given time for the sharp turn from straight to bent.
Solution exactOf(const model::Arm& arm, const Load& load, const model::Twists& unloaded) {
  ExactOptions options;
  options.max_iterations = 500;
  return ExactArm(arm, load, options).solve(unloaded);
}

TEST(Buckling, TheNamedLoadsAreUnderAndPastTheCriticalOnes) {
  for (const Column& column : columns()) {
    const model::Arm arm = column.arm();
    const model::Twists straight = arm.twists(arm.inputAt(0));
    EXPECT_GT(column.critical(), 0.01) << column.name;
    for (const double share : kShares) {
      if (share > 2.0) continue;  // where it is wound up
      const Solution found = exactOf(arm, column.load(share, 1e-4, 0.3), straight);
      ASSERT_TRUE(found.converged()) << column.name << " " << share;
      if (share <= column.under) {
        EXPECT_LT(swingOf(found, arm.restLength()), 0.05) << column.name << " " << share;
      }
      if (share >= column.past) {
        EXPECT_GT(swingOf(found, arm.restLength()), 0.1) << column.name << " " << share;
      }
    }
  }
}

TEST(Buckling, LoadedTiersFindTheStableShapeOrSayThatTheyDidNot) {
  test::Random random(801);
  for (const Column& column : columns()) {
    const model::Arm arm = column.arm();
    const model::Twists straight = arm.twists(arm.inputAt(0));
    int all_under = 0, found_under = 0, found_past = 0, refused_past = 0;
    {
      // The least order errs by as much where a column is about to give way.
      Family wrong(std::string("0.1 to 12 of its load, ") + column.name, 1e-2, "of the length");
      for (const double share : kShares) {
        for (const double imperfection : kImperfections) {
          const Load load = column.load(share, imperfection, random.uniform(0, 2 * test::kPi));
          const Solution truth = exactOf(arm, load, straight);
          for (int order = kLeastOrder; order <= kMostOrder; ++order) {
            const Solution found = LoadedArm(arm, load, order).solve(straight);
            EXPECT_TRUE(found.tip.translation.allFinite());
            all_under += share <= column.under;
            refused_past += share >= column.past && !found.converged();
            if (!found.converged()) continue;
            found_under += share <= column.under;
            found_past += share >= column.past;
            if (!truth.converged()) continue;
            wrong.add((found.tip.translation - truth.tip.translation).norm() / arm.restLength(),
                      text("order %d at %g of it, %g aside", order, share, imperfection));
          }
        }
      }
    }
    std::printf("  under it %d of %d found, past it %d found and %d refused\n", found_under,
                all_under, found_past, refused_past);
    EXPECT_GT(found_under, 3 * all_under / 4) << column.name;
    EXPECT_GT(refused_past, 0) << column.name;
  }
}

TEST(Buckling, TheTierChosenForABuckledColumnKeepsItsAccuracy) {
  const Column column = columns()[2];
  const model::Arm arm = column.arm();
  for (const double share : {0.3, 0.9, 1.2, 2.0}) {
    Family family(text("tier auto at %g of its load", share), kUsualTipError, "of the length");
    const Load load = column.load(share, 1e-2, 0.3);
    const ArmModel model(arm, std::nullopt, load);
    const ExactArm exact(arm, load);
    if (share > 1) {
      EXPECT_EQ(model.choice().setting.tier, Tier::kExact) << share;
    }
    test::Random random(803);
    for (int i = 0; i < 20; ++i) {
      const Eigen::VectorXd q = i == 0 ? arm.inputAt(0) : test::randomInput(arm, random);
      const Solution truth = exact.solve(arm.twists(q));
      const Tip found = model.tip(q);
      EXPECT_EQ(found.converged(), truth.converged());
      family.add((found.tip.translation - truth.tip.translation).norm() / arm.restLength(),
                 model.choice().setting.name());
    }
  }
}

TEST(Buckling, StabilityIsDecidedWithoutTheHeap) {
  const Column column = columns()[1];
  const model::Arm arm = column.arm();
  const model::Twists straight = arm.twists(arm.inputAt(0));
  for (const double share : {0.8, 1.5}) {
    const LoadedArm loaded(arm, column.load(share, 1e-4, 0.3), 5);
    const bool stands = loaded.tip(straight).converged();
    EXPECT_EQ(stands, share < 1);
    const test::AllocationCounter counter;
    loaded.tip(straight);
    EXPECT_EQ(counter.count(), 0u) << share;
  }
}

}  // namespace
}  // namespace helix_arm::statics
