#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

#include <gtest/gtest.h>

#include "helix_arm/statics/workspace.hpp"
#include "support/loaded_arm.hpp"
#include "support/paper_arm.hpp"
#include "support/tip_grid.hpp"

namespace helix_arm::statics {
namespace {

constexpr std::uint64_t kSeed = 1;

WorkspaceExtremes sampledExtremes(const ArmModel& model, int count) {
  WorkspaceExtremes out;
  out.add(Workspace(model, {kSeed, false}).sample(0, count));
  return out;
}

// Every extreme is a tip that the model has within the limits, and none is less than was given.
void expectTrue(const ArmModel& model, const WorkspaceExtremes& sampled,
                const WorkspaceExtremes& found) {
  for (int which = 0; which < WorkspaceExtremes::kCount; ++which) {
    const auto& [input, tip] = found.of(which);
    EXPECT_GE(WorkspaceExtremes::extent(which, tip),
              WorkspaceExtremes::extent(which, sampled.of(which).tip));
    for (int i = 0; i < input.size(); ++i) {
      EXPECT_TRUE(model.arm().actuator(i).limits.contains(input[i])) << input[i];
    }
    EXPECT_LT((model.tip(input).tip.translation - tip).norm(), 1e-12);
    EXPECT_TRUE(found.bounds().contains(tip + 1e-12 * (found.bounds().center() - tip)));
    EXPECT_LE(tip.norm(), found.reach());
  }
}

TEST(WorkspaceExtremes, AVentedStraightArmReachesAsFarAsItsMusclesAreLong) {
  // Without pressure every muscle has its free length, and a curve is no longer than that.
  for (const int sections : {1, 3, 5}) {
    const ArmModel model(test::ringArm(test::straightRing(), sections));
    const double vented = sections * test::fig3Muscle().length(0);
    const WorkspaceExtremes sampled = sampledExtremes(model, 2000);
    ASSERT_LT(sampled.reach(), vented - 1e-4) << "samples miss it";
    const WorkspaceExtremes found = findExtremes(model, sampled);
    expectTrue(model, sampled, found);
    EXPECT_NEAR(found.reach(), vented, 1e-12);
    EXPECT_NEAR(found.bounds().max().x(), vented, 1e-12);
  }
}

TEST(WorkspaceExtremes, NoTipOfAFineGridIsBeyondThemAndTheyAreHardlyBeyondTheGrid) {
  // The last curls to more than a circle: some of its extremes lie inside the limits.
  const test::Ring curling{3, 0.006, 0.0, {10.0, 0.0, 1e-6}};
  for (const test::Ring& ring : {test::straightRing(), test::helicalRing(), curling}) {
    const model::Arm arm = test::ringArm(ring);
    const test::TipGrid tips(arm, 101);
    double grid[WorkspaceExtremes::kCount];
    std::fill(std::begin(grid), std::end(grid), -1e9);
    for (std::size_t j = 0; j < tips.count(); ++j) {
      const Eigen::Vector3d tip = tips.tip(j);
      const double extents[] = {-tip.x(), -tip.y(), -tip.z(),  tip.x(),
                                tip.y(),  tip.z(),  tip.norm()};
      for (int k = 0; k < WorkspaceExtremes::kCount; ++k) grid[k] = std::max(grid[k], extents[k]);
    }
    const ArmModel model(arm);
    const WorkspaceExtremes sampled = sampledExtremes(model, 1000);
    const WorkspaceExtremes found = findExtremes(model, sampled);
    expectTrue(model, sampled, found);
    for (int k = 0; k < WorkspaceExtremes::kCount; ++k) {
      const double extent = WorkspaceExtremes::extent(k, found.of(k).tip);
      EXPECT_GE(extent, grid[k] - 1e-9) << k;
      EXPECT_LE(extent, grid[k] + 1e-3) << k;
    }
  }
}

TEST(WorkspaceExtremes, UnderLoadTheyAreTipsOfTheLoadedArmBeyondItsSamples) {
  const model::Arm helical = test::softHelicalArm();
  const Load load = test::weight(test::Posture::kHorizontal, 0.2, 900);
  for (const auto& [tier, count] : {std::pair{Tier::kLoaded, 2000}, {Tier::kExact, 4}}) {
    TierRequest request;
    request.tier = tier;
    const ArmModel model(helical, {}, load, request);
    const WorkspaceExtremes sampled = sampledExtremes(model, count);
    const WorkspaceExtremes found = findExtremes(model, sampled);
    expectTrue(model, sampled, found);
    EXPECT_GT(found.reach(), sampled.reach());
    EXPECT_GT(found.bounds().volume(), sampled.bounds().volume());
  }
}

// A ring of equal muscles, or of muscles whose radius, tilt and limits differ.
model::Section randomSection(int muscles, bool equal, test::Random& random) {
  const model::Contraction muscle = test::fig3Muscle();
  const double radius = random.uniform(0.02, 0.05), tilt = random.uniform(0, 0.3);
  model::Section section;
  for (int i = 0; i < muscles; ++i) {
    model::Range limits = muscle.inputRange();
    if (!equal)
      limits = {random.uniform(0, 0.4) * limits.upper, random.uniform(0.6, 1) * limits.upper};
    section.actuators.push_back(
        {"muscle",
         test::ringPose(i, muscles, equal ? radius : random.uniform(0.02, 0.05),
                        equal ? tilt : random.uniform(-0.3, 0.3)),
         {random.logUniform(10, 100), equal ? 0 : 1e-5, 1.2e-4},
         muscle,
         limits});
  }
  return section;
}

model::Arm randomArm(const std::vector<int>& muscles, bool equal, test::Random& random) {
  std::vector<model::Section> sections;
  for (const int count : muscles) sections.push_back(randomSection(count, equal, random));
  return model::Arm(sections);
}

// Largest extent by random search: accepts random changes of one input, shrinking when they fail.
double farthest(const ArmModel& model, int which, int starts, double least, test::Random& random) {
  const model::Arm& arm = model.arm();
  const auto extent = [&](const Eigen::VectorXd& q) {
    const Tip tip = model.tip(q);
    return tip.converged() ? WorkspaceExtremes::extent(which, tip.tip.translation) : -1e9;
  };
  double best = -1e9;
  for (int start = 0; start < starts; ++start) {
    Eigen::VectorXd q = test::randomInput(arm, random);
    double here = extent(q);
    int failed = 0;
    for (double radius = 0.5; radius > least;) {
      Eigen::VectorXd next = q;
      const int i = random.integer(0, arm.actuatorCount() - 1);
      next[i] += radius * random.normal() * (arm.inputAt(1.0) - arm.inputAt(0.0))[i];
      next = arm.clamped(next);
      const double there = extent(next);
      if (there > here) {
        here = there;
        q = next;
        failed = 0;
      } else if (++failed > 2 * arm.actuatorCount()) {
        radius *= 0.5;
        failed = 0;
      }
    }
    best = std::max(best, here);
  }
  return best;
}

struct RandomCase {
  std::vector<int> muscles;  // per section
  bool equal;
};

TEST(WorkspaceExtremes, NoRandomSearchFindsATipBeyondTheBoundOrBeyondACertifiedReach) {
  test::Random random(107);
  int certified = 0, cases = 0;
  for (const RandomCase& one : {RandomCase{{3}, true},
                                {{6}, false},
                                {{14}, true},
                                {{14}, false},
                                {{3, 3}, true},
                                {{3, 3}, false},
                                {{7, 7}, true},
                                {{7, 7}, false},
                                {{5, 5, 4}, true},
                                {{5, 5, 4}, true},
                                {{5, 5, 4}, false}}) {
    const ArmModel model(randomArm(one.muscles, one.equal, random));
    const WorkspaceExtremes sampled = sampledExtremes(model, 5000);
    const WorkspaceExtremes found = findExtremes(model, sampled);
    expectTrue(model, sampled, found);
    ++cases;
    certified += found.certified() ? 1 : 0;
    // One section has at most six independent twists, however many its muscles.
    EXPECT_TRUE(found.certified() || one.muscles.size() > 1);
    EXPECT_TRUE(std::isfinite(found.reachBound()));
    for (int which = 0; which < WorkspaceExtremes::kCount; ++which) {
      const double extent = WorkspaceExtremes::extent(which, found.of(which).tip);
      const double other = farthest(model, which, 40, 1e-4, random);
      EXPECT_LE(extent, found.boundOf(which));
      EXPECT_LE(other, found.boundOf(which));
      EXPECT_LE(other, extent + 1e-3 * found.reach()) << which << " of case " << cases;
      EXPECT_TRUE(found.outerBounds().contains(found.of(which).tip));
    }
  }
  EXPECT_GE(certified, 6) << "of " << cases;
  EXPECT_LT(certified, cases);  // the others say so
}

TEST(WorkspaceExtremes, UnderLoadNoRandomSearchFindsMuchMoreAndNothingIsCertified) {
  test::Random random(108);
  for (const RandomCase& one :
       {RandomCase{{14}, false}, {{3, 3}, true}, {{5, 5, 4}, true}, {{5, 5, 4}, true}}) {
    const model::Arm arm = randomArm(one.muscles, one.equal, random);
    const ArmModel model(arm, {}, test::randomLoad(arm.sectionCount(), random),
                         TierSetting{Tier::kLoaded, 4});
    const WorkspaceExtremes sampled = sampledExtremes(model, 500);
    const WorkspaceExtremes found = findExtremes(model, sampled);
    expectTrue(model, sampled, found);
    EXPECT_FALSE(found.certified());
    EXPECT_EQ(found.reachBound(), std::numeric_limits<double>::infinity());
    for (int which = 0; which < WorkspaceExtremes::kCount; ++which) {
      const double extent = WorkspaceExtremes::extent(which, found.of(which).tip);
      EXPECT_LE(farthest(model, which, 4, 1e-2, random), extent + 1e-3 * found.reach()) << which;
    }
  }
}

TEST(WorkspaceExtremes, OfNothingThereIsNoBox) {
  const WorkspaceExtremes none;
  EXPECT_TRUE(none.empty());
  EXPECT_TRUE(none.bounds().isEmpty());
  EXPECT_EQ(none.reach(), 0.0);
}

}  // namespace
}  // namespace helix_arm::statics
