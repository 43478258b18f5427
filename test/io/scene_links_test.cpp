// ring.phase_deg, plate_m and arm.tool.
#include <gtest/gtest.h>

#include "helix_arm/model/curve.hpp"
#include "scene_faults.hpp"
#include "support/scene_text.hpp"

namespace helix_arm::io {
namespace {

Scene sceneWith(const std::vector<Override>& overrides, const std::string& name = "spatial_50") {
  return loadScene(HELIX_ARM_SOURCE_DIR "/config/scenes/" + name + ".yaml", overrides);
}

double apart(const lie::SE3& a, const lie::SE3& b) {
  return (a.translation - b.translation).norm() + (a.rotation - b.rotation).norm();
}

TEST(ScenePhase, AThirdOfATurnPermutesTheInputsOfThreeMuscles) {
  for (const char* const name : {"spatial_50", "helical_50"}) {
    const Scene plain = sceneWith({}, name);
    const Scene turned = sceneWith({{"arm.sections.0.ring.phase_deg", "120"}}, name);
    const Eigen::Vector3d q(3e5, 1e5, 2e4), moved(2e4, 3e5, 1e5);
    // Muscle 1 of the turned ring sits where muscle 2 of the plain one does.
    EXPECT_LT(apart(turned.arm.actuator(0).X_O, plain.arm.actuator(1).X_O), 1e-15);
    EXPECT_LT(apart(turned.arm.tip(q), plain.arm.tip(moved)), 1e-13) << name;
    EXPECT_GT(apart(turned.arm.tip(q), plain.arm.tip(q)), 0.05) << name;
  }
}

TEST(ScenePhase, ZeroHasTheSameBits) {
  const Scene plain = sceneWith({}), zero = sceneWith({{"arm.sections.0.ring.phase_deg", "0"}});
  const Eigen::Vector3d q(3e5, 1e5, 2e4);
  EXPECT_EQ(plain.arm.tip(q).translation, zero.arm.tip(q).translation);
  EXPECT_EQ(plain.arm.actuator(2).X_O.translation, zero.arm.actuator(2).X_O.translation);
}

TEST(ScenePhase, HalfATurnSwapsTheMusclesOfAPlanarArm) {
  const Scene plain = sceneWith({}, "planar_50");
  const Scene turned = sceneWith({{"arm.sections.0.ring.phase_deg", "180"}}, "planar_50");
  EXPECT_LT(apart(turned.arm.tip(Eigen::Vector2d(3e5, 0)), plain.arm.tip(Eigen::Vector2d(0, 3e5))),
            1e-12);
}

TEST(SceneLinks, PlatesAndToolArePartOfTheTip) {
  const Scene plain = sceneWith({});
  const Scene scene =
      sceneWith({{"arm.sections.0.plate_m", "0.02"},
                 {"arm.tool", "{position_m: [0.05, 0, 0.01], rpy_deg: [90, 0, 0]}"}});
  const Eigen::Vector3d q(3e5, 1e5, 0);
  lie::SE3 link;
  link.rotation << 1, 0, 0, 0, 0, -1, 0, 1, 0;
  link.translation = {0.07, 0, 0.01};
  EXPECT_LT(apart(scene.arm.tip(q), plain.arm.tip(q) * link), 1e-15);
  EXPECT_LT(apart(scene.model.tip(q).tip, scene.arm.tip(q)), 1e-15);
  EXPECT_EQ(scene.arm.restLength(), plain.arm.restLength());
}

TEST(SceneLinks, TheTipLoadIsSeenFromTheTip) {
  const std::vector<Override> tool{{"arm.tool.position_m", "[0.05, 0, 0.01]"}};
  std::vector<Override> overrides = tool;
  overrides.push_back({"arm.sections.0.plate_m", "0.03"});
  const Scene scene = sceneWith(overrides, "loaded");
  const statics::PointLoad& tip = scene.model.load()->points.back();
  // position_m of the shipped scene is [0.02, 0, 0].
  EXPECT_LT((tip.offset - Eigen::Vector3d(0.10, 0, 0.01)).norm(), 1e-15);
}

TEST(SceneLinks, ThePlaneHasThemToo) {
  const Scene scene =
      sceneWith({{"arm.sections.0.plate_m", "0.02"},
                 {"arm.tool", "{position_m: [0.05, 0.01, 0], rpy_deg: [0, 0, 30]}"}},
                "planar_50");
  const Eigen::Vector2d q(3e5, 1e5);
  ASSERT_TRUE(scene.planar);
  EXPECT_EQ(scene.model.choice().setting.tier, statics::Tier::kPlanar);
  EXPECT_LT(apart(scene.model.tip(q).tip, scene.arm.tip(q)), 1e-13);
  EXPECT_LT(apart(model::tipPose(scene.model.solve(q).shape), scene.arm.tip(q)), 1e-13);
}

TEST(SceneLinks, RulesAreChecked) {
  using test::faultsOf;
  using test::replaced;
  const auto spatial = [](const char* from, const char* to) {
    return faultsOf(replaced(test::kSpatialScene, from, to));
  };
  using Faults = std::vector<std::string>;
  EXPECT_EQ(spatial("separators: 5", "plate_m: -0.1"),
            Faults{":19 arm.sections[0].plate_m is -0.1; expected a finite value >= 0"});
  EXPECT_EQ(spatial("tilt_deg: 10", "phase_deg: 400"),
            Faults{":18 arm.sections[0].ring.phase_deg is 400; expected -360 to 360 degrees"});
  const auto planar = [](const std::string& key, const std::string& value) {
    return faultsOf(test::kPlanarScene, {{key, value}});
  };
  EXPECT_EQ(planar("arm.sections.0.ring.phase_deg", "90").size(), 1u);
  EXPECT_EQ(planar("arm.tool.position_m", "[0, 0, 0.1]").size(), 1u);
  EXPECT_EQ(planar("arm.tool.rpy_deg", "[10, 0, 0]").size(), 1u);
  EXPECT_TRUE(planar("arm.tool.rpy_deg", "[0, 0, 10]").empty());
}

}  // namespace
}  // namespace helix_arm::io
