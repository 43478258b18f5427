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

TEST(SceneResponse, ATendonHasNone) {
  const std::string tendon = "    tendon: {length_m: 0.3";
  EXPECT_EQ(
      faultsOf(
          replaced(kSpatialScene, tendon, "    response: {rise_time_constant_s: 1}\n" + tendon)),
      Faults{":11 contractions.cable.response is given for a tendon, which follows its spool; "
             "expected it only where the input is a pressure"});
}

TEST(SceneVisionFaults, WhatMakesNoDetectorIsReported) {
  const auto decimate =
      faultsOf(replaced(kSpatialScene, "quad_decimate: 1.5", "quad_decimate: 2.5"));
  ASSERT_EQ(decimate.size(), 1u);
  EXPECT_EQ(decimate[0].find(":54 vision does not configure a tag detector: "), 0u) << decimate[0];
  EXPECT_TRUE(has(decimate[0], "quad_decimate is 2.5"));
  const auto hamming = faultsOf(replaced(replaced(kSpatialScene, "family: 25h9", "family: 16h5"),
                                         "max_hamming: 0", "max_hamming: 3"));
  ASSERT_EQ(hamming.size(), 1u);
  EXPECT_TRUE(has(hamming[0], "max_hamming is 3"));
}

TEST(SceneVisionFaults, TooManyTagsAreReported) {
  std::string ids, s;
  for (int i = 0; i < 65; ++i) {
    ids += (i == 0 ? "" : ", ") + std::to_string(i);
    s += i == 0 ? "0" : ", 0";
  }
  EXPECT_EQ(faultsOf(kPlanarScene + "tags: {size_m: 0.03, groups: [{ids: [" + ids + "], s: [" + s +
                     "]}]}\n"),
            Faults{":11 tags.groups place 65 tags; expected at most 64"});
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
