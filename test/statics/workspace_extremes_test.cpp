#include "helix_arm/statics/workspace_extremes.hpp"

#include <cmath>

#include <gtest/gtest.h>

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

TEST(WorkspaceExtremes, OfNothingThereIsNoBox) {
  const WorkspaceExtremes none;
  EXPECT_TRUE(none.empty());
  EXPECT_TRUE(none.bounds().isEmpty());
  EXPECT_EQ(none.reach(), 0.0);
}

}  // namespace
}  // namespace helix_arm::statics
