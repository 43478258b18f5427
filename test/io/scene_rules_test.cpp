// Every rule of a scene, broken once.

#include <gtest/gtest.h>

#include "scene_faults.hpp"

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

TEST(SceneVisionFaults, OverridesOfAbsentSectionsAreChecked) {
  EXPECT_EQ(faultsOf(kPlanarScene, {{"vision.quad_decimate", "0"}}),
            Faults{" --set vision.quad_decimate: vision.quad_decimate is 0; "
                   "expected a finite value >= 1"});
  EXPECT_EQ(faultsOf(kPlanarScene, {{"vision.quad_decimat", "1"}}),
            Faults{" --set vision.quad_decimat: vision.quad_decimat is not a "
                   "known key; did you mean quad_decimate?"});
}

}  // namespace
}  // namespace helix_arm::io
