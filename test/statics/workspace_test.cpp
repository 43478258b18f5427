#include "helix_arm/statics/workspace.hpp"

#include <algorithm>
#include <cmath>
#include <utility>
#include <vector>

#include <gtest/gtest.h>

#include "statics/arms_under_load.hpp"

namespace helix_arm::statics {
namespace {

constexpr double kEps = 2.220446049250313e-16;

const Load kWeight = test::weight(test::Posture::kHorizontal, 0.2, 900);

// One of every way that a tip is found.
std::vector<ArmModel> models() {
  const model::PlanarArm planar = test::planarArm();
  const model::Arm helical = test::softHelicalArm();
  Load in_plane = kWeight;
  in_plane.gravity = {0, -test::kGravity, 0};
  return {ArmModel(model::embed(planar), planar),
          ArmModel(helical),
          ArmModel(test::ringArm(test::straightRing(), 2)),
          ArmModel(test::linkedArm()),
          ArmModel(helical, {}, kWeight, request(Tier::kLinear)),
          ArmModel(helical, {}, kWeight, request(Tier::kLoaded, 3)),
          ArmModel(model::embed(planar), planar, in_plane, request(Tier::kLoaded, 2)),
          ArmModel(helical, {}, kWeight, request(Tier::kExact))};
}

int countFor(const ArmModel& model) {
  return model.choice().setting.tier == Tier::kExact ? 20 : 600;
}

TEST(Workspace, APointIsTheSameWhateverIsSampledWithIt) {
  const Workspace workspace{ArmModel(test::softHelicalArm())};
  const WorkspacePoints all = workspace.sample(0, 1000);
  for (const auto& [first, count] : {std::pair{0, 1}, {1, 256}, {300, 700}, {999, 1}, {5, 0}}) {
    const WorkspacePoints some = workspace.sample(first, count);
    ASSERT_EQ(some.count(), count);
    EXPECT_TRUE((some.inputs.array() == all.inputs.middleRows(first, count).array()).all());
    EXPECT_TRUE((some.tips.array() == all.tips.middleRows(first, count).array()).all());
  }
  const WorkspacePoints other = Workspace(workspace.model(), {2, false}).sample(0, 1000);
  EXPECT_FALSE((other.inputs.array() == all.inputs.array()).any());
}

Eigen::Vector3d at(const ArmModel& model, const Eigen::VectorXd& q) {
  return model.tip(q).tip.translation;
}

TEST(Workspace, SensitivityIsThatOfDifferencesOfTheModel) {
  for (const ArmModel& model : models()) {
    SCOPED_TRACE(model.choice().setting.name());
    const model::Arm& arm = model.arm();
    const WorkspacePoints points = Workspace(model, {7, true}).sample(0, countFor(model) / 10);
    ASSERT_GT(points.count(), 0);
    ASSERT_EQ(points.sensitivity.rows(), points.count());
    for (int row = 0; row < points.count(); ++row) {
      const Eigen::VectorXd q = points.inputs.row(row), lengths = arm.lengths(q);
      double pressure = 0, length = 0;
      for (int i = 0; i < q.size(); ++i) {
        const model::Range& limits = arm.actuator(i).limits;
        const double step = std::min({20.0, q[i] - limits.lower, limits.upper - q[i]});  // [Pa]
        const Eigen::VectorXd dq = step * Eigen::VectorXd::Unit(q.size(), i);
        pressure += (1e3 * (at(model, q + dq) - at(model, q - dq)) / (2 * step)).squaredNorm();
        const Eigen::VectorXd dl = 1e-5 * Eigen::VectorXd::Unit(q.size(), i);
        length += (1e-3 *
                   (model.tipOfLengths(lengths + dl).tip.translation -
                    model.tipOfLengths(lengths - dl).tip.translation) /
                   2e-5)
                      .squaredNorm();
      }
      EXPECT_NEAR(points.sensitivity(row, 0), std::sqrt(pressure), 1e-5 * std::sqrt(pressure));
      EXPECT_NEAR(points.sensitivity(row, 1), std::sqrt(length), 1e-5 * std::sqrt(length));

      const Eigen::Vector3d tip = at(model, q);
      double stiffness = 0;
      for (const model::Stiffness& stiffer :
           {model::Stiffness{1.01, 1, 1}, {1, 1.01, 1}, {1, 1, 1.01}}) {
        stiffness += (at(model.scaledStiffness(stiffer), q) - tip).squaredNorm();
      }
      if (model.load()) {
        stiffness += (at(model.scaledStiffness({1, 1, 1}, 1.01), q) - tip).squaredNorm();
      }
      EXPECT_NEAR(points.sensitivity(row, 2), std::sqrt(stiffness), 1e-9);
      EXPECT_GT(points.sensitivity(row, 2), 0.0);
    }
  }
}

// Upright and so heavy that it falls over from most shapes.
TEST(Workspace, InputsWithoutBalanceAreLeftOutAndCounted) {
  Load load = kWeight;
  load.gravity = {-test::kGravity, 0, 0};
  load.mass = {3};
  const ArmModel model(test::softHelicalArm(), {}, load, request(Tier::kLoaded, 2));
  constexpr int kCount = 300;
  const Workspace workspace(model);
  const WorkspacePoints points = workspace.sample(0, kCount);
  const Eigen::MatrixXd drawn =
      Workspace(model.withTier(request(Tier::kLinear))).sample(0, kCount).inputs;
  int next = 0;
  for (int row = 0; row < kCount; ++row) {
    const Tip tip = model.tip(drawn.row(row).transpose());
    if (!tip.converged()) continue;
    ASSERT_LT(next, points.count());
    EXPECT_TRUE((points.inputs.row(next).array() == drawn.row(row).array()).all());
    EXPECT_LT((points.tips.row(next).transpose() - tip.tip.translation).norm(), 16 * kEps);
    ++next;
  }
  EXPECT_EQ(next, points.count());
  EXPECT_EQ(points.unbalanced, kCount - next);
  EXPECT_GT(points.count(), kCount / 20);
  EXPECT_GT(points.unbalanced, kCount / 20);
}

// Each is a tip of the model within the limits; none of ten times as many other inputs is beyond.
TEST(WorkspaceExtremes, NoOtherTipIsFarBeyondThem) {
  for (const ArmModel& model : models()) {
    SCOPED_TRACE(model.choice().setting.name());
    const auto sampled = [&model](std::uint64_t seed, int count) {
      WorkspaceExtremes out;
      out.add(Workspace(model, {seed, false}).sample(0, count));
      return out;
    };
    const WorkspaceExtremes few = sampled(1, countFor(model)),
                            others = sampled(2, 10 * countFor(model)),
                            found = findExtremes(model, few);
    for (int which = 0; which < WorkspaceExtremes::kCount; ++which) {
      const auto& [input, tip] = found.of(which);
      EXPECT_EQ(model.arm().clamped(input), input);
      EXPECT_LT((model.tip(input).tip.translation - tip).norm(), 1e-12);
      const double extent = WorkspaceExtremes::extent(which, tip);
      EXPECT_GE(extent, WorkspaceExtremes::extent(which, few.of(which).tip));
      EXPECT_LE(WorkspaceExtremes::extent(which, others.of(which).tip),
                extent + 1e-3 * found.reach())
          << which;
    }
  }
}

}  // namespace
}  // namespace helix_arm::statics
