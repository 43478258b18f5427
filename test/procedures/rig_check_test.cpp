#include "procedures/rig_check.hpp"

#include <Eigen/Geometry>
#include <filesystem>
#include <variant>

#include <gtest/gtest.h>

#include "basics/pi.hpp"
#include "helix_arm/io/scene.hpp"
#include "procedures/unrolled_tags.hpp"
#include "support/has.hpp"
#include "support/sample_arm.hpp"
#include "support/shipped_scene.hpp"

namespace helix_arm::procedures {
namespace {

using test::shippedScene;

// The findings of one check.
std::vector<Finding> found(const io::Scene& scene, const std::string& check) {
  std::vector<Finding> out;
  for (const Finding& finding : checkRig(scene, 40).findings) {
    EXPECT_FALSE(finding.culprit.empty() || finding.value.empty() || finding.remedy.empty())
        << finding.check;
    if (finding.check == check) out.push_back(finding);
  }
  return out;
}

// Expects one check to find something with these overrides, and nothing without them.
void expectFinding(const std::string& scene, const std::vector<io::Override>& overrides,
                   const std::string& check, Severity severity, const std::string& culprit,
                   const std::string& value) {
  SCOPED_TRACE(check);
  EXPECT_TRUE(found(shippedScene(scene), check).empty());
  const auto findings = found(shippedScene(scene, overrides), check);
  ASSERT_FALSE(findings.empty());
  EXPECT_EQ(findings[0].severity, severity);
  EXPECT_EQ(findings[0].culprit, culprit);
  EXPECT_TRUE(test::has(findings[0].value, value));
}

void expectOneFault(const io::Scene& scene, const std::string& check, const std::string& culprit,
                    const std::string& value) {
  SCOPED_TRACE(check);
  const auto findings = found(scene, check);
  ASSERT_EQ(findings.size(), 1u);
  EXPECT_EQ(findings[0].severity, Severity::kFault);
  EXPECT_EQ(findings[0].culprit, culprit);
  EXPECT_EQ(findings[0].value, value);
}

TEST(RigCheck, TagsThatAreMountedWrongAreNamed) {
  const std::string group = "tags.groups.0.", all = "tags 0, 1, 2, 3, 4, 5, 6";
  expectFinding("demo", {{group + "position_m", "[0, 0, 0.09]"}}, "tag_off_arm", Severity::kWarning,
                all, "by 78 mm; expected at most the radius of the skin there, 37.4 mm");
  expectFinding("demo", {{group + "position_m", "[0, 0, -0.02]"}}, "tag_inside_arm",
                Severity::kFault, all, "5.4 mm from the base curve, inside the arm");
  expectFinding("demo", {{group + "rpy_deg", "[180, 0, 0]"}}, "tag_faces_inward", Severity::kFault,
                all, "180 deg from outwards; expected less than 90 deg");
  expectFinding("demo", {{group + "s", "[0.04, 0.06, 0.36, 0.52, 0.68, 0.84, 1]"}}, "tags_overlap",
                Severity::kFault, "tags 0 and 1", "mm apart; expected 34.9 mm");
}

TEST(RigCheck, WhatTheCameraDoesNotSeeIsNamed) {
  expectFinding("demo", {{"tags.size_m", "0.012"}}, "tags_too_small", Severity::kFault,
                "tags.size_m", "px a bit");
  expectFinding("demo", {{"camera.rpy_deg", "[0, 0, 30]"}}, "few_tags", Severity::kFault, "camera",
                "100 % of the workspace");
  expectFinding("demo", {{"camera.rpy_deg", "[0, -20, -145.9]"}}, "tip_outside_picture",
                Severity::kWarning, "camera", "of the workspace");
  expectFinding("demo", {{"tags.placement_prior", "{translation_m: 0.03, rotation_deg: 30}"}},
                "tip_uncertain", Severity::kWarning, "tags", "expected 3 % of the arm's length");
  expectFinding("demo", {{"camera.centre_px", "[305.6, 243.7]"}}, "camera_centre", Severity::kFault,
                "camera", "(305.6, 243.7) px");
  expectFinding("demo", {{"camera.distortion", "[-0.3, 0, 0, 0]"}}, "camera_distortion",
                Severity::kWarning, "camera", "cannot be inverted");
}

TEST(RigCheck, NoShippedSceneHasAFault) {
  for (const auto& entry :
       std::filesystem::directory_iterator(HELIX_ARM_SOURCE_DIR "/config/scenes")) {
    const io::Scene scene = io::loadScene(entry.path().string());
    for (const Finding& finding : checkRig(scene, 10).findings) {
      EXPECT_NE(finding.severity, Severity::kFault)
          << scene.name << ": " << finding.culprit << ": " << finding.value;
    }
  }
}

TEST(RigCheck, ALoadThatNoMuscleBearsIsNamed) {
  EXPECT_TRUE(found(shippedScene("loaded", {{"load.mass_kg", "90"}}), "K_eps").empty());
  EXPECT_EQ(found(shippedScene("loaded", {{"load.mass_kg", "300"}}), "K_eps").size(), 1u);
}

TEST(RigCheck, TheRegulatorIsHeldAgainstTheLimits) {
  expectFinding("demo", {{"regulator.simulated.supply_kpa", "300"}}, "supply", Severity::kWarning,
                "muscle_1", "its limit is 413.7 kPa, and the supply gives 300 kPa");
  EXPECT_TRUE(checkSupply(shippedScene("demo"), 413686).empty());
  EXPECT_EQ(checkSupply(shippedScene("demo"), 413685).size(), 1u);
  EXPECT_EQ(found(shippedScene("demo_modbus"), "no_watchdog").size(), 1u);
  EXPECT_TRUE(found(shippedScene("demo_serial"), "no_watchdog").empty());
  const auto watchdog = found(shippedScene("demo_serial"), "watchdog");
  ASSERT_EQ(watchdog.size(), 1u);
  EXPECT_EQ(watchdog[0].value, "it vents by itself 0.5 s after the last line");
}

TEST(RigCheck, ASupplyThatMayBeTooLowForTheLimitsIsNamed) {
  expectFinding("demo_modbus", {{"safety.min_supply_kpa", "299"}}, "min_supply", Severity::kWarning,
                "safety.min_supply_kpa", "it is 299 kPa, below the limit of muscle_1, 300 kPa");
  EXPECT_TRUE(
      found(shippedScene("demo_modbus", {{"safety.min_supply_kpa", "300"}}), "min_supply").empty());
}

TEST(RigCheck, ADeviceWithTooFewChannelsIsNamed) {
  io::Scene scene = shippedScene("demo_serial");
  auto& board = std::get<regulator::SerialConfig>(*scene.regulator).profile;
  EXPECT_EQ(board.channels, 8) << "docs/board.md";
  board.channels = 3;
  EXPECT_TRUE(found(scene, "device_channels").empty());
  board.channels = 2;
  expectOneFault(scene, "device_channels", "ascii_serial generic at /tmp/helix_arm_regulator",
                 "it has at most 2 channels, and the arm needs 3");
}

TEST(RigCheck, ALoadThatBucklesTheArmIsNamed) {
  expectFinding(
      "loaded",
      {{"load.mass_kg", "2"}, {"arm.stiffness.K_eps_n", "60"}, {"arm.base.rpy_deg", "[0, -90, 0]"}},
      "load_unbalanced", Severity::kWarning, "load", "no shape balances it in ");
}

// ---- Where tags are mounted ---------------------------------------------------------------------

using basics::kPi;
using Eigen::AngleAxisd;
using Eigen::Vector3d;

constexpr double kTolerance = 1e-12;

// Three muscles at 0.03 m from the centre line, at 0, 120 and 240 degrees; 0.4 m long at rest.
const model::Arm kArm = test::sampleArm(2, 3);

// A tag at an angle around the arm that faces outwards and reads along the arm.
estimation::TagPlacement tagAt(double angle, double radius) {
  const Eigen::Matrix3d outwards =
      AngleAxisd(angle - kPi / 2, Vector3d::UnitX()).toRotationMatrix();
  return {3, 1, 0.25, {outwards, radius * outwards.col(2)}};
}

UnrolledTag unroll(const estimation::TagPlacement& tag) {
  return unrolled(kArm, {0.02, {tag}}).at(0);
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

}  // namespace
}  // namespace helix_arm::procedures
