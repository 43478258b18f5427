// Every rule of tags, camera, vision and simulation, broken once.

#include <gtest/gtest.h>

#include "scene_faults.hpp"

namespace helix_arm::io {
namespace {

using test::BrokenRule;
using test::BrokenValue;
using test::Faults;
using test::faultsOf;
using test::kPlanarScene;
using test::kSpatialScene;
using test::replaced;

const BrokenValue kTagsValues[] = {
    {"tags.", "family: 25h9", "26h9",
     "36h11, 25h9, 16h5, 36h10, Circle21h7, Circle49h12, Custom48h12, Standard41h12 or "
     "Standard52h13"},
    {"tags.", "size_m: 0.02", "0", "a finite value > 0"},
    {"tags.", "size_m: 0.02", "31", "1e-06 to 10 m"},
    {"tags.groups[0].", "section: upper", "middle", "lower or upper"},
    {"tags.groups[0].", "actuator: top", "muscle_1", "left, muscle_5 or top"},
    {"tags.groups[0].", "ids: [3, 1]", "[3, 1.5]", "[1] is 1.5; expected a whole number >= 0"},
    {"tags.groups[0].", "ids: [3, 1]", "[3, -1]", "[1] is -1; expected a whole number >= 0"},
    {"tags.groups[0].", "ids: [3, 1]", "[3, 35]", " has 35; expected 0 to 34, the tags of 25h9"},
    {"tags.groups[0].", "ids: [3, 1]", "[3, 3]", " places tag 3 again; expected distinct ids"},
    {"tags.groups[1].", "ids: [0]", "[1]", " places tag 1 again; expected distinct ids"},
    {"tags.groups[1].", "ids: [0], s: [0.5]", "[], s: []", " is empty; expected at least one tag"},
    {"tags.groups[0].", "s: [0.25, 1]", "[0.25]", " has 1 entries; expected 2, one per id"},
    {"tags.groups[0].", "s: [0.25, 1]", "[0.25, 115]", "[1] is 115; expected a number from 0 to 1"},
    {"tags.groups[0].", "position_m: [0.01, -0.02, 0.04]", "[0.01, -11.7, 0.04]",
     "[1] is -11.7; expected -10 to 10 m"},
    {"tags.groups[0].", "rpy_deg: [15, 25, 35]", "[15, 25]",
     " has 2 entries; expected a list of 3 numbers, each a finite value"},
};

const BrokenRule kTagsRules[] = {
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
    {"      ids: [3, 1]\n",
     "",
     {":39 tags.groups[0].ids is missing; expected a list of numbers, each a whole number >= 0"}},
    {"    - {ids: [0], s: [0.5]}",
     "    - 5",
     {":45 tags.groups[1] is 5; expected a map of section, actuator, ids, s, position_m or "
      "rpy_deg"}},
};

const BrokenValue kCameraValues[] = {
    {"camera.", "size_px: [640, 480]", "[640, 0]", "[1] is 0; expected a whole number > 0"},
    {"camera.", "size_px: [640, 480]", "[640.5, 480]", "[0] is 640.5; expected a whole number > 0"},
    {"camera.", "size_px: [640, 480]", "[640, 48000]", "[1] is 48000; expected 1 to 20000 px"},
    {"camera.", "size_px: [640, 480]", "[8001, 8000]",
     " makes 64008000 pixels; expected at most 64000000"},
    {"camera.", "focal_px: [600, 610]", "600", "a list of 2 numbers, each a finite value > 0"},
    {"camera.", "centre_px: [320.5, 239.5]", "[320.5, .nan]",
     "[1] is .nan; expected a finite value"},
    {"camera.", "distortion: [0.1, -0.2, 0.001, -0.002, 0.05]", "[0.1, -0.2]",
     " has 2 entries; expected 4, 5 or 8: k1 k2 p1 p2 k3 k4 k5 k6"},
    {"camera.", "distortion: [0.1, -0.2,", "[0.1, .inf,", "[1] is .inf; expected a finite value"},
    {"camera.", "position_m: [1, 0.5, 0.8]", "[1, 500, 0.8]", "[1] is 500; expected -100 to 100 m"},
    {"camera.webcam.", "device: /dev/video2", "''", " is \"\"; expected the path of a device"},
    {"camera.webcam.", "fourcc: YUYV", "YUV", "MJPG, YUYV, UYVY or GREY"},
    {"camera.webcam.", "fps: 15", "0", "a finite value > 0"},
    {"camera.webcam.", "focus: 20", "auto", "a whole number from 0 to 1000000"},
    {"camera.webcam.", "exposure: 300", "-6", "a whole number from 0 to 1000000"},
    {"camera.webcam.", "exposure: 300", "gain: 3",
     " is not a known key; expected device, fourcc, fps, focus or exposure"},
};

const BrokenRule kCameraRules[] = {
    {"focal_px: [600, 610]",
     "focal_px: [0, 0]",
     {":48 camera.focal_px[0] is 0; expected a finite value > 0",
      ":48 camera.focal_px[1] is 0; expected a finite value > 0"}},
    {"  position_m: [1, 0.5, 0.8]\n",
     "",
     {":46 camera.position_m is missing; expected the position of the camera in the world [m]"}},
    {"  rpy_deg: [5, 12, 170]\n",
     "",
     {":46 camera.rpy_deg is missing; expected the rotation of its frame, whose x axis is the "
      "optical axis [degrees]"}},
};

const BrokenValue kVisionValues[] = {
    {"vision.", "quad_decimate: 1.5", "0.5", "a finite value >= 1"},
    {"vision.", "quad_sigma_px: 0.8", "80", "-10 to 10 px"},
    {"vision.", "threads: 2", "0", "a whole number from 1 to 64"},
    {"vision.", "refine_edges: false", "2", "true or false"},
    {"vision.", "max_hamming: 0", "4", "a whole number from 0 to 3"},
    {"vision.", "tracking: regions", "fast", "edges, regions or full"},
    {"vision.", "min_tags: 3", "1", "a whole number from 2 to 64"},
    {"vision.", "corner_noise_px: 0.4", "0", "a finite value > 0"},
    {"vision.", "tag_position_noise_m: 0.025", "25", "1e-06 to 1 m"},
    {"vision.", "tag_rotation_noise_deg: 5", "-5", "a finite value >= 0"},
    {"vision.", "robust_scale: 4", "0", "a finite value > 0"},
    {"vision.base_prior.", "translation_m: 0.003", "0", "a finite value > 0"},
    {"vision.base_prior.", "rotation_deg: 0.9", "360", "0.0001 to 180 degrees"},
    {"vision.", "base_prior: {translation_m: 0.003, rotation_deg: 0.9}", "0.003",
     "a map of translation_m or rotation_deg"},
    {"vision.", "bleed_prior_m: 0.0004", "0", "a finite value > 0"},
    {"vision.", "threads: 2", "nthreads: 2", " is not a known key; did you mean threads?"},
};

const BrokenValue kSimulationValues[] = {
    {"simulation.arm.", "K_gamma_scale: 0.8", "0", "a finite value > 0"},
    {"simulation.arm.", "K_kappa_scale: 1.2", "-1", "a finite value > 0"},
    {"simulation.arm.", "length_scale: 1.02", "0.43", "0.5 to 2"},
    {"simulation.arm.", "length_scale: 1.02", "length_scales: [1, 1, 1]",
     " has 3 entries; expected a list of 6 numbers, each a finite value > 0"},
    {"simulation.arm.", "length_scale: 1.02", "length_scales: [1, 1, 1, 1, 1, 3]",
     "[5] is 3; expected 0.5 to 2"},
    {"simulation.arm.", "length_scale: 1.02", "response: {play_kpa: [0], play_weight: [0.5]}",
     ".play_kpa[0] is 0; expected a finite value > 0"},
    {"simulation.arm.", "length_scale: 1.02", "response: {rise_time_constant_s: -1}",
     ".rise_time_constant_s is -1; expected a finite value >= 0"},
    {"simulation.camera.", "blur_px: 0.5", "-1", "a finite value >= 0"},
    {"simulation.camera.", "noise_gray_levels: 3", "300", "0 to 255 gray levels"},
    {"simulation.camera.", "exposure: 1.1", "0", "a finite value > 0"},
    {"simulation.camera.", "bleed_m: 0.0003", "0.3", "0 to 0.1 m"},
    {"simulation.camera.", "jpeg_quality: 80", "0", "a whole number from 1 to 100"},
    {"simulation.camera.", "clutter: 4", "-1", "a whole number from 0 to 10000"},
    {"simulation.camera.", "occluders: 2", "0.5", "a whole number from 0 to 1000"},
    {"simulation.camera.", "seed: 9", "-1", "a whole number from 0 to 4294967295"},
    {"simulation.mounts.", "camera_translation_m: 0.02", "-0.02", "a finite value >= 0"},
    {"simulation.mounts.", "camera_rotation_deg: 2", "200", "0 to 45 degrees"},
    {"simulation.mounts.", "tag_translation_m: 0.003", "3", "0 to 1 m"},
    {"simulation.mounts.", "tag_rotation_deg: 4", ".nan", "a finite value >= 0"},
    {"simulation.mounts.", "seed: 5", "0.5", "a whole number from 0 to 4294967295"},
    {"simulation.mounts.", "tag_rotation_deg: 4", "turn_deg: 4",
     " is not a known key; expected camera_translation_m, camera_rotation_deg, tag_translation_m, "
     "tag_rotation_deg or seed"},
};

const BrokenRule kSimulationRules[] = {
    {"  arm: {K_gamma_scale: 0.8, K_kappa_scale: 1.2, length_scale: 1.02, K_eps_scale: 0.9}",
     "  rig: {}",
     {":69 simulation.rig is not a known key; expected arm, mounts or camera"}},
};

TEST(SceneVisionRules, BreakingOneIsReported) {
  test::expectFaults(kSpatialScene, kTagsValues);
  test::expectFaults(kSpatialScene, kTagsRules);
  test::expectFaults(kSpatialScene, kCameraValues);
  test::expectFaults(kSpatialScene, kCameraRules);
  test::expectFaults(kSpatialScene, kVisionValues);
  test::expectFaults(kSpatialScene, kSimulationValues);
  test::expectFaults(kSpatialScene, kSimulationRules);
}

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
