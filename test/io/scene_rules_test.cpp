// Every rule of a scene, broken once.

#include <gtest/gtest.h>

#include "scene_faults.hpp"
#include "support/has.hpp"

namespace helix_arm::io {
namespace {

using namespace test;

TEST(SceneRules, BreakingOneIsReported) {
  expectFaults("spatial", kSpatialScene);
  expectFaults("planar", kPlanarScene);
  expectFaults("loaded", kLoadedScene);
}

TEST(SceneFaults, OverridesNameTheirKey) {
  const std::vector<std::pair<Override, std::string>> cases{
      {{"arm.sections.0.ring.radius_m", "-5"},
       " --set arm.sections.0.ring.radius_m: arm.sections[0].ring.radius_m is -5; expected a "
       "finite value > 0"},
      {{"safety.slew_kpas", "1"},
       " --set safety.slew_kpas: safety.slew_kpas is not a known key; did you mean slew_kpa_s?"},
      {{"safety", "{commander_timeout_s: 1, commander_timeout_s: 2}"},
       " --set safety: safety.commander_timeout_s is given twice; expected it once"},
      {{"arm.sections.7.name", "x"},
       " --set arm.sections.7.name: arm.sections has 2 entries; expected an index from 0, not 7"},
  };
  for (const auto& [change, fault] : cases) {
    EXPECT_EQ(faultsOf(kSpatialScene, {change}), Faults{fault}) << change.key;
  }
}

}  // namespace
}  // namespace helix_arm::io
