#include "helix_arm/statics/workspace.hpp"

#include <algorithm>
#include <cmath>
#include <utility>
#include <vector>

#include <gtest/gtest.h>

#include "statics/arms_under_load.hpp"
#include "support/test_size.hpp"

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

TEST(Workspace, TipsAreThoseOfTheModelAtInputsWithinTheLimits) {
  for (const ArmModel& model : models()) {
    SCOPED_TRACE(model.choice().setting.name());
    const int count = countFor(model);
    const WorkspacePoints points = Workspace(model).sample(0, count);
    ASSERT_EQ(points.count(), count);
    EXPECT_EQ(points.unbalanced, 0);
    EXPECT_EQ(points.sensitivity.rows(), 0);
    for (int row = 0; row < count; ++row) {
      const Eigen::VectorXd q = points.inputs.row(row);
      const Eigen::Vector3d tip = points.tips.row(row);
      EXPECT_LT((model.tip(q).tip.translation - tip).norm(), 16 * kEps) << row;
    }
  }
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

// Of even and independent draws, each sum below is within 5 of its standard deviations.
TEST(Workspace, InputsAreSpreadEvenlyAndIndependently) {
  constexpr int kCount = 100000, kBins = 20;
  const model::Arm arm = test::softHelicalArm();
  for (const std::uint64_t seed : {0u, 1u, 2u}) {
    const Eigen::MatrixXd inputs = Workspace(ArmModel(arm), {seed, false}).sample(0, kCount).inputs;
    Eigen::MatrixXd fraction(kCount, 3);
    for (int i = 0; i < 3; ++i) {
      const model::Range& limits = arm.actuator(i).limits;
      fraction.col(i) = (inputs.col(i).array() - limits.lower) / (limits.upper - limits.lower);
      Eigen::ArrayXd bins = Eigen::ArrayXd::Zero(kBins);
      for (const double f : fraction.col(i)) bins[static_cast<int>(kBins * f)] += 1;
      const double expected = static_cast<double>(kCount) / kBins;
      const double chi_square = (bins - expected).square().sum() / expected;
      EXPECT_LT(chi_square, kBins - 1 + 5 * std::sqrt(2.0 * (kBins - 1)));
    }
    const Eigen::MatrixXd centred = fraction.array() - 0.5;
    for (int i = 0; i < 3; ++i) {
      const double next = centred.col(i).head(kCount - 1).dot(centred.col(i).tail(kCount - 1));
      const double other = centred.col(i).dot(centred.col((i + 1) % 3));
      EXPECT_LT(std::abs(12 * next), 5 * std::sqrt(kCount)) << "of points that follow each other";
      EXPECT_LT(std::abs(12 * other), 5 * std::sqrt(kCount)) << "of two actuators";
    }
  }
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
  const WorkspacePoints sensitive = Workspace(model, {1, true}).sample(0, kCount);
  EXPECT_LE(sensitive.count(), points.count());
  EXPECT_EQ(sensitive.count() + sensitive.unbalanced, kCount);
  EXPECT_TRUE(sensitive.sensitivity.allFinite());
}

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

TEST(WorkspaceExtremes, NoRandomSearchFindsATipFarBeyondThem) {
  test::Random random(107);
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
    for (int which = 0; which < WorkspaceExtremes::kCount; ++which) {
      const double extent = WorkspaceExtremes::extent(which, found.of(which).tip);
      const double other = farthest(model, which, test::draws(6, 40), 1e-4, random);
      EXPECT_LE(other, extent + 1e-3 * found.reach())
          << which << " of " << one.muscles.size() << " sections of " << one.muscles.front();
      EXPECT_LE(extent - WorkspaceExtremes::extent(which, sampled.of(which).tip),
                found.beyond(sampled));
    }
  }
}

}  // namespace
}  // namespace helix_arm::statics
