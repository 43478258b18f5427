// Motions among zones: what was let through is clear in a dense sample, and what is clear is let
// through.
#include "helix_arm/clearance/sweep.hpp"

#include <limits>

#include <gtest/gtest.h>

#include "clearance/random_zones.hpp"
#include "support/loaded_arm.hpp"
#include "support/test_size.hpp"

namespace helix_arm::clearance {
namespace {

using Eigen::VectorXd;

// Arms of each kind: two sections in their plane, a helical one under load and without.
statics::ArmModel armOfKind(int kind) {
  if (kind == 0) {
    const model::PlanarArm plane = test::planarArm(2);
    return statics::ArmModel(model::embed(plane), plane);
  }
  if (kind == 1) {
    return statics::ArmModel(test::softHelicalArm(), std::nullopt, test::horizontalLoad(),
                             statics::TierSetting{statics::Tier::kLoaded, 3});
  }
  return statics::ArmModel(test::softHelicalArm());
}

VectorXd drawInput(const model::Arm& arm, test::Random& random) {
  VectorXd fraction(arm.actuatorCount());
  for (double& one : fraction) one = random.uniform(0, 1);
  return arm.inputAt(fraction);
}

std::vector<control::ChannelRules> channelsOf(const model::Arm& arm, double slew) {
  std::vector<control::ChannelRules> out;
  for (int i = 0; i < arm.actuatorCount(); ++i) {
    out.push_back({arm.actuator(i).name, arm.actuator(i).limits, slew * (1 + i % 3)});
  }
  return out;
}

// Up to six zones about the arm, none of which it touches at an input.
KeepOut randomScene(const statics::ArmModel& model, const VectorXd& at, test::Random& random) {
  const int sections = model.arm().sectionCount();
  KeepOut keep_out;
  keep_out.X_WB = test::randomPose(random, 0.3);
  keep_out.clearance = random.uniform(0.0, 0.02);
  keep_out.radii.assign(static_cast<std::size_t>(sections), 0.02);
  const int count = random.integer(1, 6);
  for (int tries = 0; tries < 30 && static_cast<int>(keep_out.zones.size()) < count; ++tries) {
    // About a place that the arm passes at another input.
    const model::Shape shape = model.solve(drawInput(model.arm(), random)).shape;
    clearance::Zone zone = test::randomZone(random, 0.08, 0.03, random.integer(0, 2), "post");
    zone.X_WZ.translation += model::poseAt(shape, sections - 1, random.uniform(0, 1)).translation;
    zone.X_WZ = keep_out.X_WB * zone.X_WZ;
    keep_out.zones.push_back(zone);
    if (!SweepCheck(model, keep_out).isClear(at)) keep_out.zones.pop_back();
  }
  return keep_out;
}

// The least clearance of densely sampled places of densely sampled inputs.
double leastOnTheWay(const statics::ArmModel& model, const KeepOut& keep_out,
                     const std::vector<VectorXd>& corners, int samples, int places = 60) {
  double least = std::numeric_limits<double>::infinity();
  const auto parts = static_cast<int>(corners.size()) - 1;
  for (int i = 0; i <= samples; ++i) {
    const double along = static_cast<double>(parts) * i / samples;
    const auto j = static_cast<std::size_t>(std::min(static_cast<int>(along), parts - 1));
    const VectorXd q =
        corners[j] + (along - static_cast<double>(j)) * (corners[j + 1] - corners[j]);
    const statics::Solution found = model.solve(model.arm().clamped(q));
    least = std::min(least, test::denseClearance(keep_out, found.shape, places));
  }
  return least;
}

TEST(Sweep, LetsThroughWhatIsClearInADenseSampleAndNothingElse) {
  test::Random random(1);
  int clear = 0, blocked = 0, needless = 0;
  for (int i = 0; i < test::draws(60, 1000); ++i) {
    const statics::ArmModel model = armOfKind(i % 3);
    const VectorXd from = drawInput(model.arm(), random), to = drawInput(model.arm(), random);
    const KeepOut keep_out = randomScene(model, from, random);
    const auto corners =
        pressuresOnTheWay(channelsOf(model.arm(), random.logUniform(3e4, 1e7)), {}, from, from, to);
    const auto found = SweepCheck(model, keep_out).sweep(corners);
    const double least = leastOnTheWay(model, keep_out, corners, test::draws(100, 300));
    if (found) {
      ++blocked;
      needless += least > keep_out.clearance + 0.001;
      EXPECT_LT(found->clearance, keep_out.clearance + 1e-4);
      EXPECT_EQ(found->zone, "post");
      ASSERT_GT(found->last_clear.size(), 0);
      EXPECT_TRUE(SweepCheck(model, keep_out).isClear(found->last_clear));
    } else {
      ++clear;
      EXPECT_GE(least, keep_out.clearance - 2e-4) << i;
    }
  }
  EXPECT_GT(clear, blocked / 4);
  EXPECT_GT(blocked, clear / 4);
  EXPECT_EQ(needless, 0);
}

TEST(Sweep, AnArmThatIsTooCloseMayOnlyMoveAway) {
  const statics::ArmModel model = armOfKind(0);
  const VectorXd rest = model.arm().inputAt(0.5),
                 away = model.arm().inputAt(Eigen::Vector4d(1, 0, 1, 0));
  const lie::SE3 tip = model.solve(rest).tip;
  KeepOut keep_out;
  keep_out.radii = {0.02, 0.02};
  Zone wall{"wall", HalfSpace{}, {}};
  wall.X_WZ.rotation =
      Eigen::Quaterniond::FromTwoVectors(
          Eigen::Vector3d::UnitZ(),
          Eigen::Vector3d(model.solve(away).tip.translation - tip.translation).normalized())
          .toRotationMatrix();
  for (const double gap : {0.005, -0.002}) {  // close to the wall, and in touch with it
    wall.X_WZ.translation = tip.translation - (0.02 + gap) * wall.X_WZ.rotation.col(2);
    keep_out.zones = {wall};
    const SweepCheck check(model, keep_out);
    ASSERT_FALSE(check.isClear(rest));
    EXPECT_FALSE(check.sweep({rest, away})) << gap;
    EXPECT_TRUE(check.sweep({rest, model.arm().inputAt(Eigen::Vector4d(0, 1, 0, 1))})) << gap;
    EXPECT_TRUE(check.sweep({rest, rest})) << gap;
  }
}

// Against steps of 10 us of the set point and the lag.
TEST(PressuresOnTheWay, AreThoseOfSlewAndLag) {
  test::Random random(2);
  for (int i = 0; i < 20; ++i) {
    const model::Arm arm = test::softHelicalArm();
    const VectorXd from = drawInput(arm, random), set_point = drawInput(arm, random),
                   to = drawInput(arm, random);
    const auto channels = channelsOf(arm, random.logUniform(1e5, 2e6));
    control::SafetyRules rules;
    rules.time_constant = random.uniform(0.05, 0.3);
    rules.fall_time_constant = random.uniform(0.05, 0.3);
    const auto corners = pressuresOnTheWay(channels, rules, set_point, from, to);
    EXPECT_EQ(corners.front(), from);
    EXPECT_EQ(corners.back(), to);
    VectorXd set = set_point, now = from;
    std::vector<double> nearest(corners.size(), std::numeric_limits<double>::infinity());
    constexpr double kStep = 1e-4;
    for (int k = 0; k < 60000; ++k) {
      for (std::size_t j = 0; j < corners.size(); ++j) {
        nearest[j] = std::min(nearest[j], (corners[j] - now).cwiseAbs().maxCoeff());
      }
      for (int c = 0; c < now.size(); ++c) {
        const double most = kStep * channels[static_cast<std::size_t>(c)].slew;
        set[c] += std::clamp(to[c] - set[c], -most, most);
        const double lag = set[c] < now[c] ? *rules.fall_time_constant : rules.time_constant;
        now[c] += kStep / lag * (set[c] - now[c]);
      }
    }
    // A channel that overtakes its set point changes its time constant within a step.
    for (const double away : nearest) EXPECT_LT(away, 0.02 * test::kMaxPressure);
  }
}

}  // namespace
}  // namespace helix_arm::clearance
