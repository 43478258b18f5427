// What chooseTier() promises of an accuracy and of a time, at inputs that it has not sampled.
#include <algorithm>
#include <cstdio>
#include <string>

#include <gtest/gtest.h>

#include "helix_arm/basics/median.hpp"
#include "helix_arm/statics/arm_model.hpp"
#include "helix_arm/statics/exact.hpp"
#include "helix_arm/statics/loaded.hpp"
#include "helix_arm/statics/tier.hpp"
#include "support/loaded_arm.hpp"

namespace helix_arm::statics {
namespace {

using Eigen::VectorXd;
using test::Posture;

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

model::Arm randomRings(int sections, test::Random& random) {
  std::vector<model::Section> parts;
  for (int k = 0; k < sections; ++k) {
    test::Ring ring;
    ring.count = random.integer(1, 24);
    ring.radius = random.uniform(0.02, 0.05);
    ring.tilt = random.uniform(-0.3, 0.3);
    ring.stiffness = {random.logUniform(10, 100), random.uniform(1e-5, 1e-4),
                      random.uniform(1e-4, 2e-4)};
    parts.push_back(test::ringSection(ring, test::fig3Muscle()));
  }
  return model::Arm(std::move(parts));
}

TEST(TierPromise, FiftyRandomScenesKeepTheAccuracyThatIsAskedFor) {
  test::Random random(53);
  int by_order[kMostOrder + 1] = {}, exact_ones = 0;
  double closest = 0.0;
  for (int scene = 0; scene < 50; ++scene) {
    const int sections = 1 + scene % 4;
    const model::Arm arm = randomRings(sections, random);
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
  EXPECT_LT(exact_ones, 15);
  EXPECT_GT(by_order[2] + by_order[3], 5);
  EXPECT_GT(by_order[4] + by_order[5] + by_order[6], 5);
}

// In a ring of 6, corners that repeat after three muscles bend nothing.
TEST(TierPromise, ARingOfSixIsSampledWhereItBends) {
  const model::Arm arm = test::ringArm(test::straightRing(6));
  const Load load = test::weight(Posture::kHorizontal, 0.3, 900);
  TierRequest request;
  request.relative_tip_error = 3.4e-7;
  const ArmModel model(arm, std::nullopt, load, request);
  const ExactArm exact(arm, load);
  test::Random random(59);
  for (int i = 0; i < 64; ++i) {
    VectorXd fraction(6);
    for (int muscle = 0; muscle < 6; ++muscle) fraction[muscle] = (i >> muscle) & 1;
    const VectorXd q = arm.inputAt(fraction);
    const double error =
        (model.tip(q).tip.translation - exact.solve(arm.twists(q)).tip.translation).norm() /
        arm.restLength();
    EXPECT_LE(error, *request.relative_tip_error)
        << model.choice().setting.name() << ", corner " << i;
  }
}

// Each motion that the map has is excited from one end to the other of what corners can do.
TEST(InputSamples, ReachTheExtremesOfEveryMotion) {
  test::Random random(61);
  for (const int count : {1, 2, 3, 4, 5, 6, 7, 12, 24}) {
    test::Ring ring = test::helicalRing(count);
    const model::Arm arm = test::ringArm(ring, 2);
    const auto samples = sampleInputs(arm, 40, 10);
    EXPECT_EQ(samples.front(), arm.inputAt(0.0));
    EXPECT_EQ(samples[1], arm.inputAt(1.0));
    EXPECT_EQ(samples, sampleInputs(arm, 40, 10)) << "seeded";
    const auto& map = arm.equilibrium(0).map;
    for (int row = 0; row < 6; ++row) {
      // The least and the largest of this entry of the twist, over all inputs.
      const VectorXd longest = arm.lengths(arm.inputAt(0.0)),
                     shortest = arm.lengths(arm.inputAt(1.0));
      double least = 0, largest = 0, seen_least = 1e9, seen_largest = -1e9;
      for (int i = 0; i < count; ++i) {
        const double a = map(row, i) * longest[i], b = map(row, i) * shortest[i];
        least += std::min(a, b);
        largest += std::max(a, b);
      }
      for (const VectorXd& q : samples) {
        const double value = arm.twists(q)(row, 0);
        seen_least = std::min(seen_least, value);
        seen_largest = std::max(seen_largest, value);
      }
      const double span = largest - least;
      if (span < 1e-12) continue;
      EXPECT_LE(seen_least - least, 0.1 * span) << count << " muscles, row " << row;
      EXPECT_LE(largest - seen_largest, 0.1 * span) << count << " muscles, row " << row;
    }
  }
}

}  // namespace
}  // namespace helix_arm::statics
