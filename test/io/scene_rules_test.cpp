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
      {{"arm.stifness", "1"},
       " --set arm.stifness: arm.stifness is not a known key; did you mean stiffness?"},
      {{"arm.sections.7.name", "x"},
       " --set arm.sections.7.name: arm.sections has 2 entries; expected an index from 0, not 7"},
      {{"name.first", "x"}, " --set name.first: name is rig; expected a map or a list"},
      {{"safety", "{commander_timeout_s: 1, commander_timeout_s: 2}"},
       " --set safety: safety.commander_timeout_s is given twice; expected it once"},
  };
  for (const auto& [change, fault] : cases) {
    EXPECT_EQ(faultsOf(kSpatialScene, {change}), Faults{fault}) << change.key;
  }
}

}  // namespace
}  // namespace helix_arm::io
