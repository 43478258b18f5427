// Every rule of tags, camera, vision and simulation, broken once.

#include <gtest/gtest.h>

#include "scene_faults.hpp"
#include "support/scene_text.hpp"

namespace helix_arm::io {
namespace {

using test::BrokenRule;
using test::faultsOf;
using test::kPlanarScene;
using test::kSpatialScene;
using test::replaced;

class SceneVisionRules : public testing::TestWithParam<BrokenRule> {};

TEST_P(SceneVisionRules, BreakingOneIsReported) {
  ASSERT_TRUE(faultsOf(kSpatialScene).empty());
  EXPECT_EQ(faultsOf(replaced(kSpatialScene, GetParam().from, GetParam().to)), GetParam().faults);
}

const BrokenRule kTags[] = {
    {"family: 25h9",
     "family: 26h9",
     {":36 tags.family is 26h9; expected 36h11, 25h9, 16h5, 36h10, Circle21h7, Circle49h12, "
      "Custom48h12, Standard41h12 or Standard52h13"}},
    {"size_m: 0.02", "size_m: 0", {":37 tags.size_m is 0; expected a finite value > 0"}},
    {"size_m: 0.02", "size_m: 31", {":37 tags.size_m is 31; expected 1e-06 to 10 m"}},
    {"  size_m: 0.02\n", "", {":35 tags.size_m is missing; expected a finite value > 0"}},
    {"size_m: 0.02",
     "sise_m: 0.02",
     {":37 tags.sise_m is not a known key; did you mean size_m?",
      ":35 tags.size_m is missing; expected a finite value > 0"}},
    {"  size_m: 0.02\n",
     "  size_m: 0.02\n  frame: {position_m: [0, 0, 11], rpy_deg: [0, 0]}\n",
     {":38 tags.frame.position_m[2] is 11; expected -10 to 10 m",
      ":38 tags.frame.rpy_deg has 2 entries; expected a list of 3 numbers, each a finite value"}},
    {"  size_m: 0.02\n",
     "  size_m: 0.02\n  placement_prior: {translation_m: 0, rotation_deg: 91, width: 1}\n",
     {":38 tags.placement_prior.width is not a known key; expected translation_m or rotation_deg",
      ":38 tags.placement_prior.translation_m is 0; expected a finite value > 0",
      ":38 tags.placement_prior.rotation_deg is 91; expected 0.0001 to 90 degrees"}},
    {"  size_m: 0.02\n",
     "  size_m: 0.02\n  frame: {place: [0, 0, 0]}\n",
     {":38 tags.frame.place is not a known key; expected position_m or rpy_deg"}},
    {"section: upper",
     "section: middle",
     {":39 tags.groups[0].section is middle; expected lower or upper"}},
    {"actuator: top",
     "actuator: muscle_1",
     {":40 tags.groups[0].actuator is muscle_1; expected left, muscle_5 or top"}},
    {"ids: [3, 1]",
     "ids: [3, 1.5]",
     {":41 tags.groups[0].ids[1] is 1.5; expected a whole number >= 0"}},
    {"ids: [3, 1]",
     "ids: [3, -1]",
     {":41 tags.groups[0].ids[1] is -1; expected a whole number >= 0"}},
    {"ids: [3, 1]",
     "ids: [3, 35]",
     {":41 tags.groups[0].ids has 35; expected 0 to 34, the tags of 25h9"}},
    {"ids: [3, 1]",
     "ids: [3, 3]",
     {":41 tags.groups[0].ids places tag 3 again; expected distinct ids"}},
    {"ids: [0]", "ids: [1]", {":45 tags.groups[1].ids places tag 1 again; expected distinct ids"}},
    {"ids: [0], s: [0.5]",
     "ids: [], s: []",
     {":45 tags.groups[1].ids is empty; expected at least one tag"}},
    {"      ids: [3, 1]\n",
     "",
     {":39 tags.groups[0].ids is missing; expected a list of numbers, each a whole number >= 0"}},
    {"s: [0.25, 1]", "s: [0.25]", {":42 tags.groups[0].s has 1 entries; expected 2, one per id"}},
    {"s: [0.25, 1]",
     "s: [0.25, 115]",
     {":42 tags.groups[0].s[1] is 115; expected a number from 0 to 1"}},
    {"position_m: [0.01, -0.02, 0.04]",
     "position_m: [0.01, -11.7, 0.04]",
     {":43 tags.groups[0].position_m[1] is -11.7; expected -10 to 10 m"}},
    {"rpy_deg: [15, 25, 35]",
     "rpy_deg: [15, 25]",
     {":44 tags.groups[0].rpy_deg has 2 entries; expected a list of 3 numbers, each a finite "
      "value"}},
    {"    - {ids: [0], s: [0.5]}",
     "    - 5",
     {
         ":45 tags.groups[1] is 5; expected a map of section, actuator, ids, s, position_m or "
         "rpy_deg",
     }},
};
INSTANTIATE_TEST_SUITE_P(Tags, SceneVisionRules, testing::ValuesIn(kTags));

const BrokenRule kCamera[] = {
    {"size_px: [640, 480]",
     "size_px: [640, 0]",
     {":47 camera.size_px[1] is 0; expected a whole number > 0"}},
    {"size_px: [640, 480]",
     "size_px: [640.5, 480]",
     {":47 camera.size_px[0] is 640.5; expected a whole number > 0"}},
    {"size_px: [640, 480]",
     "size_px: [640, 48000]",
     {":47 camera.size_px[1] is 48000; expected 1 to 20000 px"}},
    {"size_px: [640, 480]",
     "size_px: [8001, 8000]",
     {":47 camera.size_px makes 64008000 pixels; expected at most 64000000"}},
    {"focal_px: [600, 610]",
     "focal_px: [0, 0]",
     {":48 camera.focal_px[0] is 0; expected a finite value > 0",
      ":48 camera.focal_px[1] is 0; expected a finite value > 0"}},
    {"focal_px: [600, 610]",
     "focal_px: 600",
     {":48 camera.focal_px is 600; expected a list of 2 numbers, each a finite value > 0"}},
    {"centre_px: [320.5, 239.5]",
     "centre_px: [320.5, .nan]",
     {":49 camera.centre_px[1] is .nan; expected a finite value"}},
    {"distortion: [0.1, -0.2, 0.001, -0.002, 0.05]",
     "distortion: [0.1, -0.2]",
     {":50 camera.distortion has 2 entries; expected 4, 5 or 8: k1 k2 p1 p2 k3 k4 k5 k6"}},
    {"distortion: [0.1, -0.2,",
     "distortion: [0.1, .inf,",
     {":50 camera.distortion[1] is .inf; expected a finite value"}},
    {"position_m: [1, 0.5, 0.8]",
     "position_m: [1, 500, 0.8]",
     {":51 camera.position_m[1] is 500; expected -100 to 100 m"}},
    {"  position_m: [1, 0.5, 0.8]\n",
     "",
     {":46 camera.position_m is missing; expected the position of the camera in the world [m]"}},
    {"  rpy_deg: [5, 12, 170]\n",
     "",
     {":46 camera.rpy_deg is missing; expected the rotation of its frame, whose x axis is the "
      "optical axis [degrees]"}},
    {"device: /dev/video2",
     "device: ''",
     {":53 camera.webcam.device is \"\"; expected the path of a device"}},
    {"fourcc: YUYV",
     "fourcc: YUV",
     {":53 camera.webcam.fourcc is YUV; expected MJPG, YUYV, UYVY or GREY"}},
    {"fps: 15", "fps: 0", {":53 camera.webcam.fps is 0; expected a finite value > 0"}},
    {"focus: 20",
     "focus: auto",
     {":53 camera.webcam.focus is auto; expected a whole number from 0 to 1000000"}},
    {"exposure: 300",
     "exposure: -6",
     {":53 camera.webcam.exposure is -6; expected a whole number from 0 to 1000000"}},
    {"exposure: 300",
     "gain: 3",
     {":53 camera.webcam.gain is not a known key; expected device, fourcc, fps, focus or "
      "exposure"}},
};
INSTANTIATE_TEST_SUITE_P(Camera, SceneVisionRules, testing::ValuesIn(kCamera));

const BrokenRule kVision[] = {
    {"quad_decimate: 1.5",
     "quad_decimate: 0.5",
     {":55 vision.quad_decimate is 0.5; expected a finite value >= 1"}},
    {"quad_sigma_px: 0.8",
     "quad_sigma_px: 80",
     {":56 vision.quad_sigma_px is 80; expected -10 to 10 px"}},
    {"threads: 2", "threads: 0", {":57 vision.threads is 0; expected a whole number from 1 to 64"}},
    {"refine_edges: false",
     "refine_edges: 2",
     {":58 vision.refine_edges is 2; expected true or false"}},
    {"max_hamming: 0",
     "max_hamming: 4",
     {":59 vision.max_hamming is 4; expected a whole number from 0 to 3"}},
    {"tracking: regions",
     "tracking: fast",
     {":60 vision.tracking is fast; expected edges, regions or full"}},
    {"min_tags: 3",
     "min_tags: 1",
     {":61 vision.min_tags is 1; expected a whole number from 2 to 64"}},
    {"corner_noise_px: 0.4",
     "corner_noise_px: 0",
     {":62 vision.corner_noise_px is 0; expected a finite value > 0"}},
    {"tag_position_noise_m: 0.025",
     "tag_position_noise_m: 25",
     {":63 vision.tag_position_noise_m is 25; expected 1e-06 to 1 m"}},
    {"tag_rotation_noise_deg: 5",
     "tag_rotation_noise_deg: -5",
     {":64 vision.tag_rotation_noise_deg is -5; expected a finite value >= 0"}},
    {"robust_scale: 4",
     "robust_scale: 0",
     {":65 vision.robust_scale is 0; expected a finite value > 0"}},
    {"translation_m: 0.003",
     "translation_m: 0",
     {":66 vision.base_prior.translation_m is 0; expected a finite value > 0"}},
    {"rotation_deg: 0.9",
     "rotation_deg: 360",
     {":66 vision.base_prior.rotation_deg is 360; expected 0.0001 to 180 degrees"}},
    {"base_prior: {translation_m: 0.003, rotation_deg: 0.9}",
     "base_prior: 0.003",
     {":66 vision.base_prior is 0.003; expected a map of translation_m or rotation_deg"}},
    {"bleed_prior_m: 0.0004",
     "bleed_prior_m: 0",
     {":67 vision.bleed_prior_m is 0; expected a finite value > 0"}},
    {"threads: 2",
     "nthreads: 2",
     {":57 vision.nthreads is not a known key; did you mean threads?"}},
};
INSTANTIATE_TEST_SUITE_P(Vision, SceneVisionRules, testing::ValuesIn(kVision));

const BrokenRule kSimulation[] = {
    {"K_gamma_scale: 0.8",
     "K_gamma_scale: 0",
     {":69 simulation.arm.K_gamma_scale is 0; expected a finite value > 0"}},
    {"K_kappa_scale: 1.2",
     "K_kappa_scale: -1",
     {":69 simulation.arm.K_kappa_scale is -1; expected a finite value > 0"}},
    {"length_scale: 1.02",
     "length_scale: 0.43",
     {":69 simulation.arm.length_scale is 0.43; expected 0.5 to 2"}},
    {"length_scale: 1.02",
     "length_scales: [1, 1, 1]",
     {":69 simulation.arm.length_scales has 3 entries; expected a list of 6 numbers, each a finite "
      "value > 0"}},
    {"length_scale: 1.02",
     "length_scales: [1, 1, 1, 1, 1, 3]",
     {":69 simulation.arm.length_scales[5] is 3; expected 0.5 to 2"}},
    {"length_scale: 1.02",
     "response: {play_kpa: [0], play_weight: [0.5]}",
     {":69 simulation.arm.response.play_kpa[0] is 0; expected a finite value > 0"}},
    {"length_scale: 1.02",
     "response: {rise_time_constant_s: -1}",
     {":69 simulation.arm.response.rise_time_constant_s is -1; expected a finite value >= 0"}},
    {"blur_px: 0.5",
     "blur_px: -1",
     {":70 simulation.camera.blur_px is -1; expected a finite value >= 0"}},
    {"noise_gray_levels: 3",
     "noise_gray_levels: 300",
     {":70 simulation.camera.noise_gray_levels is 300; expected 0 to 255 gray levels"}},
    {"exposure: 1.1",
     "exposure: 0",
     {":70 simulation.camera.exposure is 0; expected a finite value > 0"}},
    {"bleed_m: 0.0003",
     "bleed_m: 0.3",
     {":70 simulation.camera.bleed_m is 0.3; expected 0 to 0.1 m"}},
    {"jpeg_quality: 80",
     "jpeg_quality: 0",
     {":70 simulation.camera.jpeg_quality is 0; expected a whole number from 1 to 100"}},
    {"clutter: 4",
     "clutter: -1",
     {":70 simulation.camera.clutter is -1; expected a whole number from 0 to 10000"}},
    {"occluders: 2",
     "occluders: 0.5",
     {":70 simulation.camera.occluders is 0.5; expected a whole number from 0 to 1000"}},
    {"seed: 9",
     "seed: -1",
     {":70 simulation.camera.seed is -1; expected a whole number from 0 to 4294967295"}},
    {"camera_translation_m: 0.02",
     "camera_translation_m: -0.02",
     {":71 simulation.mounts.camera_translation_m is -0.02; expected a finite value >= 0"}},
    {"camera_rotation_deg: 2",
     "camera_rotation_deg: 200",
     {":71 simulation.mounts.camera_rotation_deg is 200; expected 0 to 45 degrees"}},
    {"tag_translation_m: 0.003",
     "tag_translation_m: 3",
     {":71 simulation.mounts.tag_translation_m is 3; expected 0 to 1 m"}},
    {"tag_rotation_deg: 4",
     "tag_rotation_deg: .nan",
     {":71 simulation.mounts.tag_rotation_deg is .nan; expected a finite value >= 0"}},
    {"seed: 5",
     "seed: 0.5",
     {":71 simulation.mounts.seed is 0.5; expected a whole number from 0 to 4294967295"}},
    {"tag_rotation_deg: 4",
     "turn_deg: 4",
     {":71 simulation.mounts.turn_deg is not a known key; expected camera_translation_m, "
      "camera_rotation_deg, tag_translation_m, tag_rotation_deg or seed"}},
    {"  arm: {K_gamma_scale: 0.8, K_kappa_scale: 1.2, length_scale: 1.02, K_eps_scale: 0.9}",
     "  rig: {}",
     {":69 simulation.rig is not a known key; expected arm, mounts or camera"}},
};
INSTANTIATE_TEST_SUITE_P(Simulation, SceneVisionRules, testing::ValuesIn(kSimulation));

TEST(SceneVisionFaults, WhatMakesNoDetectorIsReported) {
  const auto decimate =
      faultsOf(replaced(kSpatialScene, "quad_decimate: 1.5", "quad_decimate: 2.5"));
  ASSERT_EQ(decimate.size(), 1u);
  EXPECT_EQ(decimate[0].find(":54 vision does not configure a tag detector: "), 0u) << decimate[0];
  EXPECT_NE(decimate[0].find("quad_decimate is 2.5"), std::string::npos) << decimate[0];
  const auto hamming = faultsOf(replaced(replaced(kSpatialScene, "family: 25h9", "family: 16h5"),
                                         "max_hamming: 0", "max_hamming: 3"));
  ASSERT_EQ(hamming.size(), 1u);
  EXPECT_NE(hamming[0].find("max_hamming is 3"), std::string::npos) << hamming[0];
}

TEST(SceneVisionFaults, TooManyTagsAreReported) {
  std::string ids, s;
  for (int i = 0; i < 65; ++i) {
    ids += (i == 0 ? "" : ", ") + std::to_string(i);
    s += i == 0 ? "0" : ", 0";
  }
  EXPECT_EQ(faultsOf(kPlanarScene + "tags: {size_m: 0.03, groups: [{ids: [" + ids + "], s: [" + s +
                     "]}]}\n"),
            std::vector<std::string>{":11 tags.groups place 65 tags; expected at most 64"});
}

TEST(SceneVisionFaults, TagsOfABrokenArmAreNotBlamedForIt) {
  EXPECT_EQ(faultsOf(replaced(kSpatialScene, "radius_m: 0.03", "radius_m: -5")),
            std::vector<std::string>{
                ":18 arm.sections[0].ring.radius_m is -5; expected a finite value > 0"});
}

TEST(SceneVisionFaults, OverridesOfAbsentSectionsAreChecked) {
  EXPECT_EQ(faultsOf(kPlanarScene, {{"vision.quad_decimate", "0"}}),
            std::vector<std::string>{" --set vision.quad_decimate: vision.quad_decimate is 0; "
                                     "expected a finite value >= 1"});
  EXPECT_EQ(faultsOf(kPlanarScene, {{"vision.quad_decimat", "1"}}),
            std::vector<std::string>{" --set vision.quad_decimat: vision.quad_decimat is not a "
                                     "known key; did you mean quad_decimate?"});
}

}  // namespace
}  // namespace helix_arm::io
