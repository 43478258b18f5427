#include "helix_arm/statics/workspace.hpp"

#include <cmath>
#include <optional>

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

      const model::Stiffness K = arm.actuator(0).stiffness;
      const Eigen::Vector3d tip = at(model, q);
      double stiffness = 0;
      for (const model::Stiffness& stiffer : {model::Stiffness{1.01 * K.gamma, K.tau, K.kappa},
                                              model::Stiffness{K.gamma, 1.01 * K.tau, K.kappa},
                                              model::Stiffness{K.gamma, K.tau, 1.01 * K.kappa}}) {
        stiffness += (at(model.withStiffness(stiffer), q) - tip).squaredNorm();
      }
      if (model.load()) {
        Load load = *model.load();
        for (double& K_eps : load.K_eps) K_eps *= 1.01;
        const TierSetting& setting = model.choice().setting;
        const ArmModel stiffer(
            arm, model.planar(), load,
            request(setting.tier, setting.order > 0 ? std::optional(setting.order) : std::nullopt));
        stiffness += (at(stiffer, q) - tip).squaredNorm();
      }
      EXPECT_NEAR(points.sensitivity(row, 2), std::sqrt(stiffness), 1e-9);
      EXPECT_GT(points.sensitivity(row, 2), 0.0);
    }
  }
}

TEST(Workspace, ActuatorsKeepTheirOwnStiffness) {
  const model::Arm uniform = test::softHelicalArm();
  const auto mixed = [&uniform](double gamma, double kappa) {
    model::Section section;
    for (int i = 0; i < uniform.actuatorCount(); ++i) {
      model::Actuator actuator = uniform.actuator(i);
      actuator.stiffness = {(10.0 + 20.0 * i) * gamma, 0.0, (1.0 + i) * 1e-4 * kappa};
      section.actuators.push_back(actuator);
    }
    return model::Arm({section});
  };
  const WorkspacePoints points = Workspace(ArmModel(mixed(1, 1)), {1, true}).sample(0, 50);
  for (int row = 0; row < points.count(); ++row) {
    const Eigen::VectorXd q = points.inputs.row(row);
    const Eigen::Vector3d tip = points.tips.row(row);
    const double expected = std::hypot((mixed(1.01, 1).tip(q).translation - tip).norm(),
                                       (mixed(1, 1.01).tip(q).translation - tip).norm());
    EXPECT_NEAR(points.sensitivity(row, 2), expected, 1e-12);
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

TEST(Workspace, SensitivityPerKpaIsRefusedToTendons) {
  model::Section section;
  model::Actuator actuator = test::softHelicalArm().actuator(0);
  actuator.name = "cable";
  actuator.drive = model::Drive::kTendon;
  actuator.contraction = model::Contraction::tendon(0.3, 0.01, 5);
  actuator.limits = {0, 5};
  section.actuators = {actuator};
  const ArmModel model{model::Arm({section})};
  EXPECT_EQ(Workspace(model).sample(0, 10).count(), 10);
  try {
    Workspace(model, {1, true});
    FAIL() << "it was taken";
  } catch (const std::invalid_argument& error) {
    EXPECT_STREQ(error.what(), "sensitivity: it is per kPa, and cable is a tendon; leave it out");
  }
}

}  // namespace
}  // namespace helix_arm::statics
