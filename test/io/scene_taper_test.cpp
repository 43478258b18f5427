// ring.radius_m and ring.tilt_deg as lists.
#include <gtest/gtest.h>

#include "helix_arm/localization/tag_layout.hpp"
#include "helix_arm/model/curve.hpp"
#include "scene_faults.hpp"

namespace helix_arm::io {
namespace {

Scene sceneWith(const std::string& name, const std::vector<Override>& overrides) {
  return loadScene(HELIX_ARM_SOURCE_DIR "/config/scenes/" + name + ".yaml", overrides);
}

TEST(SceneTaper, ListsAreTheEndsOfTheSection) {
  const Scene scene = sceneWith("helical_50", {{"arm.sections.0.ring.radius_m", "[0.05, 0.025]"},
                                               {"arm.sections.0.ring.tilt_deg", "[0, 15]"}});
  ASSERT_TRUE(scene.arm.tapered());
  for (int i = 0; i < 3; ++i) {
    const model::Actuator& muscle = scene.arm.actuator(i);
    EXPECT_NEAR(model::poseAlong(muscle, 0.0).translation.norm(), 0.05, 1e-15);
    EXPECT_NEAR(model::poseAlong(muscle, 0.4).translation.norm(), 0.04, 1e-15);
    const lie::SE3 end = model::poseAlong(muscle, 1.0), middle = model::poseAlong(muscle, 0.5);
    EXPECT_NEAR(end.translation.norm(), 0.025, 1e-15);
    EXPECT_NEAR(std::acos(end.rotation(0, 0)) * 180 / 3.14159265358979, 15, 1e-9);
    EXPECT_NEAR(std::acos(middle.rotation(0, 0)) * 180 / 3.14159265358979, 7.5, 1e-9);
  }
}

TEST(SceneTaper, EqualValuesHaveTheBitsOfOneNumber) {
  const Scene one = sceneWith("helical_50", {}),
              list = sceneWith("helical_50", {{"arm.sections.0.ring.radius_m", "[0.0254, 0.0254]"},
                                              {"arm.sections.0.ring.tilt_deg", "[15, 15]"}});
  const Eigen::Vector3d q(3e5, 1e5, 0);
  EXPECT_FALSE(list.arm.tapered());
  EXPECT_EQ(list.model.tip(q).tip.translation, one.model.tip(q).tip.translation);
}

TEST(SceneTaper, ThePlaneTakesIt) {
  const Scene scene = sceneWith("planar_50", {{"arm.sections.0.ring.radius_m", "[0.05, 0.025]"}});
  ASSERT_TRUE(scene.planar && scene.planar->tapered());
  EXPECT_EQ(scene.model.choice().setting.tier, statics::Tier::kPlanar);
  const Eigen::Vector2d q(3e5, 0);
  EXPECT_LT((scene.model.tip(q).tip.translation - scene.arm.tip(q).translation).norm(),
            1e-5 * scene.arm.restLength());
  EXPECT_LT(
      (model::tipPose(scene.model.solve(q).shape).translation - scene.model.tip(q).tip.translation)
          .norm(),
      1e-13);
}

TEST(SceneTaper, TagsFollowTheirMuscle) {
  const Scene scene = sceneWith("demo", {{"arm.sections.0.ring.radius_m", "[0.05, 0.025]"}});
  const estimation::TagPlacement& first = scene.tags->tags.front();
  const double stand =
      (first.X_ST.translation - model::poseAlong(scene.arm.actuator(0), first.s).translation)
          .norm();
  int on_first = 0;
  for (const estimation::TagPlacement& tag : scene.tags->tags) {
    if (tag.id > 6) continue;
    ++on_first;
    EXPECT_NEAR(
        (tag.X_ST.translation - model::poseAlong(scene.arm.actuator(0), tag.s).translation).norm(),
        stand, 1e-12);
  }
  EXPECT_EQ(on_first, 7);
  // A rendered rig and its fits use pieces.
  EXPECT_GT(scene.model.solve(Eigen::Vector3d(1e5, 0, 0)).shape.piecesPerSection(), 1);
}

}  // namespace
}  // namespace helix_arm::io
