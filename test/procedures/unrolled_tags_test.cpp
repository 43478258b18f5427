#include "helix_arm/procedures/unrolled_tags.hpp"

#include <Eigen/Geometry>
#include <cmath>

#include <gtest/gtest.h>

#include "helix_arm/basics/pi.hpp"
#include "helix_arm/io/scene.hpp"
#include "support/random.hpp"
#include "support/sample_arm.hpp"

namespace helix_arm::procedures {
namespace {

using basics::kPi;
using Eigen::AngleAxisd;
using Eigen::Vector3d;

constexpr double kTolerance = 1e-12;

// Three muscles at 0.03 m from the centre line, at 0, 120 and 240 degrees; 0.4 m long at rest.
const model::Arm kArm = test::sampleArm(2, 3);

// A tag at an angle around the arm that faces outwards, reads along the arm, and is then turned
// counter-clockwise as its reader sees it.
estimation::TagPlacement tagAt(double angle, double radius, double turn = 0) {
  const Eigen::Matrix3d outwards =
      AngleAxisd(angle - kPi / 2, Vector3d::UnitX()).toRotationMatrix();
  return {3,
          1,
          0.25,
          {outwards * AngleAxisd(turn, Vector3d::UnitZ()).toRotationMatrix(),
           radius * outwards.col(2)}};
}

UnrolledTag unroll(const estimation::TagPlacement& tag) {
  return unrolled(kArm, {0.02, {tag}}).at(0);
}

TEST(UnrolledTags, ATagAboveAMuscleStandsOffItsCentreLine) {
  for (int muscle = 0; muscle < 3; ++muscle) {
    const UnrolledTag tag = unroll(tagAt(2 * kPi * muscle / 3, 0.046));
    EXPECT_EQ(tag.id, 3);
    EXPECT_EQ(tag.section, 1);
    EXPECT_EQ(tag.s, 0.25);
    EXPECT_EQ(tag.actuator, 3 + muscle) << "of its own section";
    EXPECT_NEAR(tag.angle, 2 * kPi * muscle / 3, kTolerance);
    EXPECT_NEAR(tag.radius, 0.046, kTolerance);
    EXPECT_NEAR(tag.standoff, 0.016, kTolerance);
    EXPECT_NEAR(tag.aside, 0, kTolerance);
    EXPECT_NEAR(tag.from_base, 0.1, kTolerance);
    EXPECT_NEAR(tag.turn, 0, kTolerance);
    EXPECT_NEAR(tag.tilt, 0, 1e-7);
  }
}

TEST(UnrolledTags, AnglesAndTurnsAreThoseOfAnyMounting) {
  test::Random random(20);
  for (int i = 0; i < 200; ++i) {
    const double angle = random.uniform(0, 2 * kPi), turn = random.uniform(-kPi, kPi);
    const UnrolledTag tag = unroll(tagAt(angle, 0.05, turn));
    EXPECT_NEAR(tag.angle, angle, 1e-9);
    EXPECT_NEAR(tag.turn, turn, 1e-9);
    EXPECT_NEAR(tag.tilt, 0, 1e-7);
    // Seen from the nearest muscle, which is at most 60 degrees away.
    const double off = angle - 2 * kPi * (tag.actuator - 3) / 3;
    EXPECT_GE(std::cos(off), 0.5 - 1e-12);
    EXPECT_NEAR(tag.standoff, 0.05 * std::cos(off) - 0.03, 1e-9);
    EXPECT_NEAR(tag.aside, 0.05 * std::sin(off), 1e-9);
  }
}

TEST(UnrolledTags, ATiltedFaceAndAShiftAlongTheArmAreTold) {
  estimation::TagPlacement tag = tagAt(1.0, 0.05);
  tag.X_ST.rotation = tag.X_ST.rotation * AngleAxisd(0.2, Vector3d::UnitX()).toRotationMatrix();
  tag.X_ST.translation.x() = -0.003;
  EXPECT_NEAR(unroll(tag).tilt, 0.2, 1e-9);
  EXPECT_NEAR(unroll(tag).from_base, 0.097, kTolerance);
  tag.X_ST.rotation = tag.X_ST.rotation * AngleAxisd(kPi, Vector3d::UnitX()).toRotationMatrix();
  EXPECT_NEAR(unroll(tag).tilt, kPi - 0.2, 1e-9) << "it faces the arm";
}

TEST(UnrolledTags, AnglesDoNotReachAWholeTurn) {
  for (const double rounding : {-1e-17, 0.0, 1e-17}) {
    estimation::TagPlacement tag = tagAt(0, 0.05);
    tag.X_ST.translation.z() = rounding;
    EXPECT_LT(unroll(tag).angle, 1e-9);
  }
  EXPECT_NEAR(unroll(tagAt(-0.001, 0.05)).angle, 2 * kPi - 0.001, 1e-9);
}

TEST(UnrolledTags, OnTheCentreLineTheFaceTellsTheSide) {
  const UnrolledTag tag = unroll(tagAt(2.0, 0.0, 0.3));
  EXPECT_NEAR(tag.angle, 2.0, 1e-9);
  EXPECT_NEAR(tag.turn, 0.3, 1e-9);
  EXPECT_EQ(tag.radius, 0);
  EXPECT_NEAR(tag.tilt, 0, 1e-7);
}

TEST(UnrolledTags, ABracketOfTheHelicalArmIsAsTheSceneGivesIt) {
  // 42.545 mm above its muscle and 11.7094 mm aside, in a frame that is tilted by 15 degrees.
  const io::Scene scene =
      io::loadScene(std::string(HELIX_ARM_SOURCE_DIR) + "/config/scenes/helical_50.yaml");
  const double tilt = 15 * kPi / 180;
  const std::vector<UnrolledTag> tags = unrolled(scene.arm, *scene.tags);
  ASSERT_EQ(tags.size(), 8u);
  for (const UnrolledTag& tag : tags) {
    EXPECT_EQ(scene.arm.actuator(tag.actuator).name,
              tag.id == 10 || tag.id == 11 || tag.id >= 30 ? "muscle_2" : "muscle_3");
    EXPECT_NEAR(tag.standoff, 0.042545, 1e-9);
    EXPECT_NEAR(tag.aside, 0.0117094 * std::cos(tilt), 1e-9);
    EXPECT_NEAR(tag.from_base, tag.s * scene.arm.restLength(0) - 0.0117094 * std::sin(tilt), 1e-9);
  }
}

}  // namespace
}  // namespace helix_arm::procedures
