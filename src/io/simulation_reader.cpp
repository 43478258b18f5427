#include "simulation_reader.hpp"

#include <limits>

#include "helix_arm/io/number.hpp"
#include "pose_reader.hpp"
#include "response_reader.hpp"

namespace helix_arm::io {
namespace {

const NumberRule kStiffnessScale = within(kPositive, 1e-3, 1e3);
const NumberRule kLengthScale = within(kPositive, 0.5, 2);
const NumberRule kMountTranslation = within(kNotNegative, 0, 1, " m");
const NumberRule kMountRotation = within(kNotNegative, 0, 45, " degrees");
const NumberRule kBlur = within(kNotNegative, 0, 100, " px");
const NumberRule kGrayNoise = within(kNotNegative, 0, 255, " gray levels");
const NumberRule kExposure = within(kPositive, 1e-3, 1e3);
const NumberRule kBleed = within(kNotNegative, 0, 0.1, " m");

// @param actuators  0 if the arm has faults: the number of length scales is then not checked.
simulation::ArmDeviation readDeviation(const Value& value, const std::string& path, int actuators,
                                       FaultList& faults) {
  const MapReader keys(value, path,
                       {"K_gamma_scale", "K_kappa_scale", "length_scale", "length_scales",
                        "K_eps_scale", "response"},
                       faults);
  simulation::ArmDeviation arm;
  arm.K_gamma_scale = keys.number("K_gamma_scale", kStiffnessScale, arm.K_gamma_scale);
  arm.K_kappa_scale = keys.number("K_kappa_scale", kStiffnessScale, arm.K_kappa_scale);
  arm.length_scale = keys.number("length_scale", kLengthScale, arm.length_scale);
  arm.K_eps_scale = keys.number("K_eps_scale", kStiffnessScale, arm.K_eps_scale);
  if (const Value* response = value.find("response")) {
    arm.response = readResponse(*response, keys.path("response"), faults);
  }
  if (keys.has("length_scales")) {
    const auto scales =
        keys.numbers("length_scales", static_cast<std::size_t>(actuators), kLengthScale);
    if (scales) {
      arm.length_scales = Eigen::Map<const Eigen::VectorXd>(
          scales->data(), static_cast<Eigen::Index>(scales->size()));
    }
  }
  return arm;
}

simulation::MountDeviation readMounts(const MapReader& keys) {
  simulation::MountDeviation mounts;
  mounts.camera_translation =
      keys.number("camera_translation_m", kMountTranslation, mounts.camera_translation);
  if (const auto deg = keys.optionalNumber("camera_rotation_deg", kMountRotation)) {
    mounts.camera_rotation = radians(*deg);
  }
  mounts.tag_translation =
      keys.number("tag_translation_m", kMountTranslation, mounts.tag_translation);
  if (const auto deg = keys.optionalNumber("tag_rotation_deg", kMountRotation)) {
    mounts.tag_rotation = radians(*deg);
  }
  mounts.seed = static_cast<std::uint32_t>(
      keys.integer("seed", 0, std::numeric_limits<std::uint32_t>::max(), mounts.seed));
  return mounts;
}

simulation::SimulatedCameraConfig readPictures(const MapReader& keys) {
  simulation::SimulatedCameraConfig camera;
  camera.blur = keys.number("blur_px", kBlur, camera.blur);
  camera.noise = keys.number("noise_gray_levels", kGrayNoise, camera.noise);
  camera.exposure = keys.number("exposure", kExposure, camera.exposure);
  camera.bleed = keys.number("bleed_m", kBleed, camera.bleed);
  camera.jpeg_quality = static_cast<int>(keys.integer("jpeg_quality", 1, 100, camera.jpeg_quality));
  camera.clutter = static_cast<int>(keys.integer("clutter", 0, 10000, camera.clutter));
  camera.occluders = static_cast<int>(keys.integer("occluders", 0, 1000, camera.occluders));
  camera.seed = static_cast<std::uint32_t>(
      keys.integer("seed", 0, std::numeric_limits<std::uint32_t>::max(), camera.seed));
  return camera;
}

}  // namespace

SimulationConfig readSimulation(const MapReader& scene, const Value& document, const ArmParts* arm,
                                FaultList& faults) {
  SimulationConfig config;
  const Value* value = document.find("simulation");
  if (value == nullptr) return config;
  const MapReader simulation(*value, scene.path("simulation"), {"arm", "mounts", "camera"}, faults);
  if (const Value* deviation = value->find("arm")) {
    config.arm = readDeviation(*deviation, simulation.path("arm"),
                               arm == nullptr ? 0 : arm->arm.actuatorCount(), faults);
  }
  if (const Value* mounts = value->find("mounts")) {
    config.mounts = readMounts(MapReader(*mounts, simulation.path("mounts"),
                                         {"camera_translation_m", "camera_rotation_deg",
                                          "tag_translation_m", "tag_rotation_deg", "seed"},
                                         faults));
  }
  if (const Value* camera = value->find("camera")) {
    config.camera = readPictures(MapReader(*camera, simulation.path("camera"),
                                           {"blur_px", "noise_gray_levels", "exposure", "bleed_m",
                                            "jpeg_quality", "clutter", "occluders", "seed"},
                                           faults));
  }
  return config;
}

}  // namespace helix_arm::io
