// Loads every scene that is shipped and checks it against the published parameters of its arm.

#include <Eigen/Geometry>
#include <cmath>
#include <filesystem>
#include <set>

#include <gtest/gtest.h>

#include "basics/pi.hpp"
#include "helix_arm/io/scene.hpp"
#include "scene_faults.hpp"

namespace helix_arm::io {
namespace {

using basics::kPi;
constexpr double kPsi = 6894.76;  // as the experiments counted: 60 psi are 413.6856 kPa [Pa]
constexpr double kMaxPressure = 413685.6;

// Published fits of the free length [m] over the gauge pressure in psi.
constexpr double kFig3Quintic[] = {4.269760703e-1, -3.982361379e-4, -8.216242656e-5,
                                   5.394266367e-7, 2.666729952e-8,  -3.002668523e-10};
constexpr double kPlanarQuintic[] = {4.422327618e-1, -8.616576226e-4, -1.351653817e-4,
                                     4.567416495e-6, -5.593052718e-8, 2.401903883e-10};

double quinticOfPsi(const double (&c)[6], double pressure) {
  double sum = 0;
  for (int k = 0; k < 6; ++k) sum += c[k] * std::pow(pressure / kPsi, k);
  return sum;
}

struct PublishedArm {
  const char* scene;
  bool planar;
  int muscles;
  double radius;  // [m]
  double tilt;    // [rad]
  const double (&quintic)[6];
  double gamma, kappa;
};

const PublishedArm kArms[] = {
    {"planar_50", true, 2, 0.0508 / 2, 0, kPlanarQuintic, 10, 1.38e-4},
    {"planar_76", true, 2, 0.0762 / 2, 0, kPlanarQuintic, 10, 1.38e-4},
    {"planar_101", true, 2, 0.1016 / 2, 0, kPlanarQuintic, 10, 1.38e-4},
    {"spatial_50", false, 3, 0.0508 / 2, 0, kFig3Quintic, 10, 1.38e-4},
    {"spatial_101", false, 3, 0.1016 / 2, 0, kFig3Quintic, 10, 1.38e-4},
    {"helical_50", false, 3, 0.0508 / 2, 15 * kPi / 180, kFig3Quintic, 100, 9.8e-5},
    {"demo", false, 3, 0.0508 / 2, 15 * kPi / 180, kFig3Quintic, 100, 9.8e-5},
    {"loaded", false, 3, 0.0508 / 2, 15 * kPi / 180, kFig3Quintic, 100, 9.8e-5},
};

class ShippedArm : public testing::TestWithParam<PublishedArm> {};
INSTANTIATE_TEST_SUITE_P(Scenes, ShippedArm, testing::ValuesIn(kArms),
                         [](const auto& arm) { return std::string(arm.param.scene); });

TEST_P(ShippedArm, HasItsPublishedLayout) {
  const PublishedArm& published = GetParam();
  const Scene scene = test::shippedScene(published.scene);
  EXPECT_EQ(scene.name, published.scene);
  EXPECT_EQ(scene.planar.has_value(), published.planar);
  EXPECT_EQ(scene.arm.sectionCount(), 1);
  ASSERT_EQ(scene.arm.actuatorCount(), published.muscles);
  for (int i = 0; i < published.muscles; ++i) {
    const model::Actuator& muscle = scene.arm.actuator(i);
    const double th = 2 * kPi * i / published.muscles;
    const Eigen::Vector3d outward(0, std::cos(th), std::sin(th)),
        around(0, -std::sin(th), std::cos(th));
    EXPECT_NEAR((muscle.X_O.translation - published.radius * outward).norm(), 0, 1e-16);
    const Eigen::Vector3d tangent =
        std::cos(published.tilt) * Eigen::Vector3d::UnitX() + std::sin(published.tilt) * around;
    EXPECT_NEAR((muscle.X_O.rotation.col(0) - tangent).norm(), 0, 1e-15);
    EXPECT_EQ(muscle.stiffness.gamma, published.gamma);
    EXPECT_EQ(muscle.stiffness.tau, 0);
    EXPECT_EQ(muscle.stiffness.kappa, published.kappa);
    EXPECT_EQ(muscle.drive, model::Drive::kPressure);
    EXPECT_EQ(muscle.limits.lower, 0);
    EXPECT_DOUBLE_EQ(muscle.limits.upper, kMaxPressure);
    EXPECT_TRUE(muscle.limits.contains(kMaxPressure)) << "60 psi must be within the limits";
  }
}

TEST_P(ShippedArm, ContractsAsPublished) {
  const PublishedArm& published = GetParam();
  const Scene scene = test::shippedScene(published.scene);
  const model::Contraction& contraction = scene.arm.actuator(0).contraction;
  for (int i = 0; i <= 60; ++i) {
    const double pressure = kMaxPressure * i / 60;
    EXPECT_NEAR(contraction.length(pressure), quinticOfPsi(published.quintic, pressure), 1e-14)
        << pressure;
  }
}

TEST(ShippedScenes, AllLoadAndCanBeLaunchedAndTheSafetyCoreAcceptsThem) {
  std::set<std::string> found;
  for (const auto& entry :
       std::filesystem::directory_iterator(std::string(HELIX_ARM_SOURCE_DIR) + "/config/scenes")) {
    const std::string name = entry.path().stem().string();
    SCOPED_TRACE(name);
    found.insert(name);
    const Scene scene = loadScene(entry.path().string());
    EXPECT_EQ(scene.name, name);
    EXPECT_TRUE(scene.regulator);
    for (int k = 0; k < scene.arm.sectionCount(); ++k) EXPECT_EQ(scene.arm.equilibrium(k).rank, 6);
    const Eigen::VectorXd vented = Eigen::VectorXd::Zero(scene.arm.actuatorCount());
    EXPECT_TRUE(scene.arm.tip(vented).translation.allFinite())
        << "a vented arm must be within the limits";
    ASSERT_EQ(scene.safety.channels.size(), static_cast<std::size_t>(scene.arm.actuatorCount()));
    const control::SafetyCore core(scene.safety.channels, scene.safety.rules);
    EXPECT_EQ(core.state(), control::SafetyState::kDisabled);
  }
  EXPECT_EQ(found,
            (std::set<std::string>{"annotated", "demo", "demo_modbus", "demo_serial", "helical_50",
                                   "loaded", "mocap", "planar_101", "planar_50", "planar_76",
                                   "spatial_101", "spatial_50", "tapered_50_25"}));
}

TEST(ShippedScenes, TheHelicalArmsTagsAreWhereTheRigHadThem) {
  const Scene scene = test::shippedScene("helical_50");
  ASSERT_TRUE(scene.tags);
  EXPECT_EQ(scene.tags->size, 0.031);
  const int ids[2][4] = {{10, 11, 30, 31}, {6, 7, 8, 9}};
  const double along[] = {0, 0.115, 0.245, 0.365};
  ASSERT_EQ(scene.tags->tags.size(), 8u);
  for (int group = 0; group < 2; ++group) {
    const lie::SE3& X_SM = scene.arm.actuator(1 + group).X_O;
    for (int i = 0; i < 4; ++i) {
      const estimation::TagPlacement& tag = scene.tags->tags[scene.tags->find(ids[group][i])];
      EXPECT_EQ(tag.section, 0);
      EXPECT_NEAR(tag.s * 0.46, along[i], 1e-9) << tag.id;
      const Eigen::Vector3d moved = X_SM.inverse() * tag.X_ST.translation;
      EXPECT_LT((moved - Eigen::Vector3d(0, -0.0117094, 0.042545)).norm(), 1e-15) << tag.id;
      EXPECT_LT((tag.X_ST.rotation - X_SM.rotation).norm(), 1e-14) << tag.id;
    }
  }
  // The tag at the base as every capture of the rig has it, since all were aligned to it.
  const std::vector<lie::SE3> poses =
      estimation::tagPoses(*scene.tags, scene.arm.twists(Eigen::VectorXd::Zero(3)));
  const lie::SE3& X_B6 = poses[scene.tags->find(6)];
  EXPECT_LT(
      (X_B6.translation - Eigen::Vector3d(-0.00303062691, -0.0241773527, -0.0644974634)).norm(),
      1e-6);
  const Eigen::Quaterniond q(X_B6.rotation);
  const Eigen::Quaterniond measured(0.25660332, 0.957662719, 0.126077587, -0.0337830599);
  EXPECT_LT(q.angularDistance(measured), 1e-5);
}

TEST(ShippedScenes, TheAnnotatedSceneShowsTheDefaultsOfVision) {
  const vision::LocalizerConfig shown = test::shippedScene("annotated").vision, defaults;
  EXPECT_EQ(test::membersOf(shown), test::membersOf(defaults));
  EXPECT_EQ(shown.fit.rotation_noise, defaults.fit.rotation_noise);
  EXPECT_NEAR(shown.fit.base_prior.rotation, defaults.fit.base_prior.rotation, 1e-4);
}

}  // namespace
}  // namespace helix_arm::io
