// Columns under, at and past the load that buckles them: the loaded tier finds the shape that the
// exact one finds, or says that it did not.
#include <algorithm>
#include <cmath>

#include "extremes/family.hpp"
#include "helix_arm/statics/arm_model.hpp"
#include "helix_arm/statics/exact.hpp"
#include "helix_arm/statics/loaded.hpp"
#include "support/allocation_counter.hpp"
#include "support/paper_arm.hpp"

namespace helix_arm::statics {
namespace {

using Eigen::Vector3d;
using test::Family;
using test::text;

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
