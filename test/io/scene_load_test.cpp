#include <gtest/gtest.h>

#include "scene_faults.hpp"

namespace helix_arm::io {
namespace {

using namespace test;

// A straight rod of 0.4 m along the base's x that resists bending in all planes.
const std::string kRod = R"(name: rod
contractions:
  muscle: {table: {pressure_kpa: [0, 400], length_m: [0.4, 0.3]}}
arm:
  geometry: spatial
  stiffness: {K_gamma: 10, K_tau_m2: 0, K_kappa_m2: 1.0e-4, K_eps_n: 900}
  sections: [{name: only, ring: {count: 3, radius_m: 0.03, contraction: muscle}}]
)";

TEST(SceneLoad, WhatTheWorldSeesIsTurnedIntoTheBase) {
  const Scene scene = sceneOf(kLoadedScene);
  ASSERT_TRUE(scene.model.load());
  const statics::Load& loads = *scene.model.load();
  const Eigen::Matrix3d& R_WB = scene.X_WB.rotation;
  EXPECT_LT((R_WB * loads.gravity - Eigen::Vector3d(0.1, 0.2, -9.7)).norm(), 1e-14);
  ASSERT_EQ(loads.points.size(), 3u);
  EXPECT_LT((R_WB * loads.points[0].force - Eigen::Vector3d(0.1, 0.2, 0.3)).norm(), 1e-15);
  EXPECT_LT((R_WB * loads.points[0].moment - Eigen::Vector3d(0.01, 0, -0.02)).norm(), 1e-16);
  EXPECT_LT((R_WB * loads.points[1].force - Eigen::Vector3d(0.4, 0, 0)).norm(), 1e-15);
  EXPECT_LT((R_WB * loads.points[1].moment - Eigen::Vector3d(0, 0.03, 0)).norm(), 1e-16);
  EXPECT_LT((R_WB * loads.points[2].force - Eigen::Vector3d(0, 0.5, 0)).norm(), 1e-15);
  // Places and masses are as given.
  const statics::PointLoad &tip = loads.points[0], &upper = loads.points[1];
  EXPECT_EQ(tip.section, 1);
  EXPECT_EQ(tip.s, 1);
  EXPECT_EQ(tip.mass, 0.05);
  EXPECT_EQ(tip.offset, Eigen::Vector3d(0.02, 0, 0.01));
  EXPECT_EQ(upper.section, 1);
  EXPECT_EQ(upper.s, 0.5);
  EXPECT_EQ(upper.mass, 0.02);
  EXPECT_EQ(upper.offset, Eigen::Vector3d(0, 0.03, 0));
}

TEST(SceneLoad, TheArmsMassIsSpreadByRestLengths) {
  // The muscles of the lower section are 0.4 m long at 0 kPa, tilted by 10 degrees; the bellows of
  // the upper one 0.1 m.
  const Scene scene = sceneOf(kLoadedScene);
  const double lower = scene.arm.restLength(0), upper = scene.arm.restLength(1);
  ASSERT_GT(lower, 3 * upper);
  const std::vector<double>& mass = scene.model.load()->mass;
  ASSERT_EQ(mass.size(), 2u);
  EXPECT_NEAR(mass[0] + mass[1], 0.3, 1e-16);
  EXPECT_NEAR(mass[0] / mass[1], lower / upper, 1e-13);
  const Scene each = sceneOf(kLoadedScene, {{"load.mass_kg", "[0.2, 0.05]"}});
  EXPECT_EQ(each.model.load()->mass, (std::vector<double>{0.2, 0.05}));
}

TEST(SceneLoad, GravityPointsDownByDefault) {
  const Scene flat = sceneOf(kRod, {{"load.mass_kg", "0.2"}});
  EXPECT_EQ(flat.model.load()->gravity, Eigen::Vector3d(0, 0, -9.81));
  // A base that pitches by 90 degrees looks down.
  const Scene hanging =
      sceneOf(kRod, {{"load.mass_kg", "0.2"}, {"arm.base", "{rpy_deg: [0, 90, 0]}"}});
  EXPECT_LT((hanging.model.load()->gravity - Eigen::Vector3d(9.81, 0, 0)).norm(), 1e-14);
}

TEST(SceneLoad, OnlyALoadInItsPlaneKeepsAPlanarArmThere) {
  const std::string stiff =
      replaced(kPlanarScene, "K_kappa_m2: 1.0e-4}", "K_kappa_m2: 1.0e-4, K_eps_n: 900}");
  EXPECT_TRUE(sceneOf(kPlanarScene).vision.fit.planar);
  // y of the base is -z of the world.
  const Override turned{"arm.base", "{rpy_deg: [-90, 0, 0]}"}, mass{"load.mass_kg", "0.1"};
  EXPECT_TRUE(sceneOf(stiff, {turned, mass}).vision.fit.planar);
  EXPECT_FALSE(sceneOf(stiff, {mass}).vision.fit.planar);
  EXPECT_FALSE(
      sceneOf(stiff, {turned, mass, {"load.tip", "{force_n: [0, 0.1, 0]}"}}).vision.fit.planar);
  EXPECT_EQ(sceneOf(stiff, {turned, mass, {"tier", "planar"}}).model.choice().setting.tier,
            statics::Tier::kPlanar);
}

TEST(SceneTier, AccuracyIsInPercentOfTheArm) {
  const auto choice = [](const char* percent) {
    return sceneOf(kRod, {{"load.mass_kg", "0.2"}, {"accuracy.tip_error_percent", percent}})
        .model.choice();
  };
  const statics::TierChoice rough = choice("1"), fine = choice("0.001");
  EXPECT_LE(rough.relative_tip_error, 1e-2);
  EXPECT_LE(fine.relative_tip_error, 1e-5);
  ASSERT_EQ(rough.setting.tier, statics::Tier::kLoaded);
  EXPECT_GT(rough.relative_tip_error, 1e-5) << "or the rough one is no other than the fine one";
  EXPECT_TRUE(fine.setting.tier == statics::Tier::kExact ||
              fine.setting.order > rough.setting.order);
}

}  // namespace
}  // namespace helix_arm::io
