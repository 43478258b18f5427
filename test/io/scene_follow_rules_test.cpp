// What a scene says of the loop that is closed over vision; every rule broken once.

#include <gtest/gtest.h>

#include "helix_arm/basics/pi.hpp"
#include "scene_faults.hpp"

namespace helix_arm::io {
namespace {

using follow::OnContact;
using test::BrokenRule;
using test::BrokenValue;
using test::faultsOf;
using test::kPlanarScene;
using test::kSpatialScene;
using test::sceneOf;

// Every key, from line 73 on.
const std::string kFollowScene = kSpatialScene + R"(follow:
  smoothing_s: 0.4
  mode_hz: 4
  mode_damping: 0.2
  stale_s: 0.5
  coast_s: 5
  hysteresis: 0.1
  creep: 0.3
  bias_translation_m: 0.004
  bias_rotation_deg: 3
  on_contact: stop
  contact_limit: 40
  reading_noise_kpa: 1.5
)";
const std::string kSerialRegulator =
    "regulator: {ascii_serial: {profile: generic, device: /dev/ttyUSB0, addresses: [a, b]}}\n";

const BrokenValue kFollowValues[] = {
    {"follow.", "smoothing_s: 0.4", "0", "a finite value > 0"},
    {"follow.", "smoothing_s: 0.4", "4000", "0.001 to 3600 s"},
    {"follow.", "mode_hz: 4", "-4", "a finite value > 0"},
    {"follow.", "mode_hz: 4", "2000", "0.01 to 1000 Hz"},
    {"follow.", "mode_damping: 0.2", "2", "0.001 to 1"},
    {"follow.", "stale_s: 0.5", "0", "a finite value > 0"},
    {"follow.", "coast_s: 5", ".inf", "a finite value > 0"},
    {"follow.", "hysteresis: 0.1", "1.5", "0 to 1"},
    {"follow.", "creep: 0.3", "-1", "a finite value >= 0"},
    {"follow.", "creep: 0.3", "101", "0 to 100 per square root of a second"},
    {"follow.", "bias_translation_m: 0.004", "4", "1e-06 to 1 m"},
    {"follow.", "bias_rotation_deg: 3", "0", "a finite value > 0"},
    {"follow.", "on_contact: stop", "vent", "report, yield or stop"},
    {"follow.", "contact_limit: 40", "0.5", "1 to 1000000"},
    {"follow.", "reading_noise_kpa: 1.5", "0", "a finite value > 0"},
    {"follow.", "stale_s: 0.5", "stale: 0.5", " is not a known key; did you mean stale_s?"},
};

const BrokenRule kFollowRules[] = {
    {"  mode_hz: 4\n",
     "",
     {":74 follow.mode_damping is given without mode_hz; expected both or none"}},
};

TEST(FollowRules, BreakingOneIsReported) {
  test::expectFaults(kFollowScene, kFollowValues);
  test::expectFaults(kFollowScene, kFollowRules);
}

TEST(FollowScene, IsInSi) {
  const follow::VisualServoConfig config = sceneOf(kFollowScene).follow;
  const follow::VisualServoConfig& loop = config;
  EXPECT_EQ(loop.smoothing, 0.4);
  EXPECT_EQ(loop.stale_after, 0.5);
  EXPECT_EQ(loop.coast_time, 5);
  EXPECT_EQ(loop.time_constant, 0.3) << "of safety.follow";
  EXPECT_EQ(loop.reading_noise, 1500);
  EXPECT_EQ(loop.filter.hysteresis, 0.1);
  EXPECT_EQ(loop.filter.creep, 0.3);
  EXPECT_NEAR(loop.watch_creep, 0.03, 1e-15);
  EXPECT_EQ(loop.filter.bias_translation, 0.004);
  EXPECT_NEAR(loop.filter.bias_rotation, 3 * basics::kPi / 180, 1e-15);
  EXPECT_NEAR(loop.filter.settling_time, 1 / (2 * basics::kPi * 4 * 0.2), 1e-15);
  EXPECT_EQ(config.on_contact, OnContact::kStop);
  EXPECT_EQ(config.contact.limit, 40);
  EXPECT_NO_THROW(loop.validate());
}

TEST(FollowScene, OmittedKeysHaveTheDefaultsOfTheLoop) {
  const follow::VisualServoConfig usual{};
  const follow::VisualServoConfig config = sceneOf(kPlanarScene).follow;
  EXPECT_EQ(config.smoothing, usual.smoothing);
  EXPECT_EQ(config.stale_after, usual.stale_after);
  EXPECT_EQ(config.coast_time, usual.coast_time);
  EXPECT_EQ(config.watch_creep, usual.watch_creep);
  EXPECT_EQ(config.filter.hysteresis, usual.filter.hysteresis);
  EXPECT_EQ(config.filter.creep, usual.filter.creep);
  EXPECT_EQ(config.filter.settling_time, usual.filter.settling_time);
  EXPECT_EQ(config.time_constant, control::SafetyRules().time_constant);
  EXPECT_EQ(config.contact.limit, 32);
  EXPECT_NO_THROW(config.validate());
}

TEST(FollowScene, NoiseIsThatOfTheSimulatedRegulatorOrOfTypicalHardware) {
  EXPECT_EQ(sceneOf(kSpatialScene).follow.reading_noise, 2e3);
  EXPECT_EQ(sceneOf(kPlanarScene + "regulator: {simulated: {noise_kpa: 7}}\n").follow.reading_noise,
            7e3);
  EXPECT_EQ(sceneOf(kPlanarScene + kSerialRegulator).follow.reading_noise, 2e3);
  const Scene silent = sceneOf(kPlanarScene + "regulator: {simulated: {noise_kpa: 0}}\n");
  EXPECT_NO_THROW(silent.follow.validate()) << "an observer needs some";
}

TEST(FollowScene, HardwareYieldsUnlessToldOtherwise) {
  EXPECT_EQ(sceneOf(kPlanarScene).follow.on_contact, OnContact::kReport);
  EXPECT_EQ(sceneOf(kSpatialScene).follow.on_contact, OnContact::kReport);
  EXPECT_EQ(sceneOf(kPlanarScene + kSerialRegulator).follow.on_contact, OnContact::kYield);
  EXPECT_EQ(
      sceneOf(kPlanarScene + kSerialRegulator, {{"follow.on_contact", "report"}}).follow.on_contact,
      OnContact::kReport);
}

// The rule of follow::smoothingFor(), with the lag of 0.2 s that safety has by default.
TEST(FollowScene, AVibrationSetsTheSmoothingTime) {
  const auto smoothing = [](const std::vector<Override>& changes) {
    return sceneOf(kPlanarScene, changes).follow.smoothing;
  };
  const double least = follow::smoothingFor(1.5, 0.1, 0.2);
  ASSERT_GT(least, 0.2);
  EXPECT_EQ(smoothing({{"follow.mode_hz", "1.5"}}), least);
  EXPECT_EQ(smoothing({{"follow.mode_hz", "1.5"}, {"follow.mode_damping", "0.1"}}), least);
  ASSERT_LT(follow::smoothingFor(20, 0.1, 0.2), 0.2);
  EXPECT_EQ(smoothing({{"follow.mode_hz", "20"}}), 0.2) << "a fast mode needs no more than usual";
  EXPECT_EQ(smoothing({{"follow.mode_hz", "1.5"}, {"follow.smoothing_s", "3"}}), 3);
  const std::vector<std::string> faults =
      faultsOf(kPlanarScene + "follow: {mode_hz: 1.5, smoothing_s: 0.3}\n");
  ASSERT_EQ(faults.size(), 1u);
  EXPECT_EQ(faults[0].find(":11 follow.smoothing_s is 0.3; expected at least 0.49 s, "), 0u)
      << faults[0];
  EXPECT_NE(faults[0].find("leave out smoothing_s"), std::string::npos) << faults[0];
}

}  // namespace
}  // namespace helix_arm::io
