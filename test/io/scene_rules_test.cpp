// Every rule of a scene, broken once.

#include <gtest/gtest.h>

#include "scene_faults.hpp"
#include "support/has.hpp"
#include "support/refusal.hpp"

namespace helix_arm::io {
namespace {

using namespace test;

TEST(SceneRules, BreakingOneIsReported) {
  expectFaults("spatial", kSpatialScene);
  expectFaults("planar", kPlanarScene);
  expectFaults("loaded", kLoadedScene);
}

TEST(SceneResponse, PlaysMayTakeAll) {
  const std::string curve = "length_m: [0.1, 0.12, 0.13]}\n";
  for (const char* const response : {"{}", "{play_kpa: [20, 60], play_weight: [0.3, 0.65]}"}) {
    EXPECT_EQ(faultsOf(replaced(kSpatialScene, curve, curve + "    response: " + response + "\n")),
              Faults());
  }
}

TEST(SceneVisionFaults, WhatMakesNoDetectorIsReported) {
  const auto hamming = faultsOf(replaced(replaced(kSpatialScene, "family: 25h9", "family: 16h5"),
                                         "max_hamming: 0", "max_hamming: 3"));
  ASSERT_EQ(hamming.size(), 1u);
  EXPECT_TRUE(has(hamming[0], "max_hamming is 3"));
}

TEST(SceneFaults, AllAreReportedAtOnce) {
  std::string text = replaced(kSpatialScene, "name: rig", "name: ''");
  text = replaced(text, "length_m: [0.1, 0.12, 0.13]", "length_m: [0.1, 0.12, 0.11]");
  text = replaced(text, "geometry: spatial", "geometry: round");
  text = replaced(text, "radius_m: 0.03", "radius_m: -5");
  text = replaced(text, "separators: 5", "seperators: 5");
  text = replaced(text, "noise_kpa: 2", "noise_kpa: much");
  text = replaced(text, "commander_timeout_s: 0.8", "commander_timeout_s: -1");
  const auto faults = faultsOf(text, {{"arm.sections.0.ring.count", "0"}});
  const char* starts[] = {
      ":1 name",
      ":9 contractions.bellows.table",
      ":13 arm.geometry",
      ":19 arm.sections[0].seperators is not a known key; did you mean separators?",
      " --set arm.sections.0.ring.count: arm.sections[0].ring.count is 0; expected a whole",
      ":18 arm.sections[0].ring.radius_m",
      ":33 regulator.simulated.noise_kpa",
      ":34 safety.commander_timeout_s"};
  ASSERT_EQ(faults.size(), std::size(starts));
  for (std::size_t i = 0; i < faults.size(); ++i)
    EXPECT_EQ(faults[i].find(starts[i]), 0u) << faults[i];
}

TEST(SceneFaults, OverridesNameTheirKey) {
  const std::vector<std::pair<Override, std::string>> cases{
      {{"arm.sections.0.ring.radius_m", "-5"},
       " --set arm.sections.0.ring.radius_m: arm.sections[0].ring.radius_m is -5; expected a "
       "finite value > 0"},
      {{"arm.stifness", "1"},
       " --set arm.stifness: arm.stifness is not a known key; did you mean stiffness?"},
      {{"safty.commander_timeout_s", "1"},
       " --set safty.commander_timeout_s: safty is not a known key; did you mean safety?"},
      {{"arm.sections.7.name", "x"},
       " --set arm.sections.7.name: arm.sections has 2 entries; expected an index from 0, not 7"},
      {{"arm.sections.first", "x"},
       " --set arm.sections.first: arm.sections has 2 entries; expected an index from 0, not "
       "first"},
      {{"name.first", "x"}, " --set name.first: name is rig; expected a map or a list"},
      {{"arm..name", "x"},
       " --set arm..name: is not a key; expected words and numbers separated by dots"},
      {{"", "x"}, " --set : is not a key; expected words and numbers separated by dots"},
      {{"name", ""}, " --set name: name is empty; expected a word of letters, digits, _ and -"},
      {{"safety", "{commander_timeout_s: 1, commander_timeout_s: 2}"},
       " --set safety: safety.commander_timeout_s is given twice; expected it once"},
  };
  for (const auto& [change, fault] : cases) {
    EXPECT_EQ(faultsOf(kSpatialScene, {change}), Faults{fault}) << change.key;
  }
  const auto syntax = faultsOf(kSpatialScene, {{"name", "[1"}});
  ASSERT_EQ(syntax.size(), 1u);
  EXPECT_EQ(syntax[0].find(" --set name: is not YAML: "), 0u) << syntax[0];
}

}  // namespace
}  // namespace helix_arm::io
