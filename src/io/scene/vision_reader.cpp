#include "vision_reader.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>
#include <string>
#include <vector>

#include "helix_arm/basics/pi.hpp"
#include "helix_arm/io/number.hpp"
#include "helix_arm/vision/jpeg.hpp"
#include "helix_arm/vision/tag_detector.hpp"
#include "io/document/map_reader.hpp"
#include "section_reader.hpp"

namespace helix_arm::io {

const Eigen::Matrix3d kOpticalInBody =
    (Eigen::Matrix3d() << 0, 0, 1, -1, 0, 0, 0, -1, 0).finished();

namespace {

bool wholeAndPositive(double x) { return x > 0 && x == std::floor(x); }

const NumberRule kPixels{"a whole number > 0", wholeAndPositive, 1, 20000, " px"};
const NumberRule kFocalLength = within(kPositive, 1, 1e6, " px");
const NumberRule kPixelCoordinate = within(kFinite, -1e5, 1e5, " px");
const NumberRule kDistortion = within(kFinite, -1e4, 1e4);
// A camera farther away than this was given in mm.
const NumberRule kPlace = within(kFinite, -100, 100, " m");
const NumberRule kFrameRate = within(kPositive, 0.01, 1000, " Hz");

std::array<double, 8> readDistortion(const MapReader& camera) {
  std::array<double, 8> distortion = {};
  if (!camera.has("distortion")) return distortion;
  const auto given = camera.numbers("distortion", 0, kDistortion);
  if (!given) return distortion;
  if (given->size() != 4 && given->size() != 5 && given->size() != 8) {
    camera.complain("distortion", "has " + std::to_string(given->size()) +
                                      " entries; expected 4, 5 or 8: k1 k2 p1 p2 k3 k4 k5 k6");
    return distortion;
  }
  std::copy(given->begin(), given->end(), distortion.begin());
  return distortion;
}

vision::WebcamConfig readWebcam(const Value& value, const std::string& path,
                                const estimation::Camera& model, FaultList& faults) {
  constexpr int kLargest = 1'000'000;
  const MapReader keys(value, path, {"device", "fourcc", "fps", "focus", "exposure"}, faults);
  vision::WebcamConfig webcam;
  webcam.width = model.width;
  webcam.height = model.height;
  if (keys.has("device")) {
    webcam.device = keys.text("device", "the path of a device").value_or(webcam.device);
  }
  if (keys.has("fourcc")) {
    webcam.fourcc = keys.choice("fourcc", {"MJPG", "YUYV", "UYVY", "GREY"}).value_or(webcam.fourcc);
  }
  webcam.fps = keys.number("fps", kFrameRate, webcam.fps);
  webcam.focus = static_cast<int>(keys.integer("focus", 0, kLargest, webcam.focus));
  webcam.exposure = static_cast<int>(keys.integer("exposure", 0, kLargest, webcam.exposure));
  return webcam;
}

}  // namespace

std::optional<CameraConfig> readCamera(const MapReader& scene, const Value& document,
                                       FaultList& faults) {
  const Value* value = document.find("camera");
  if (value == nullptr) return std::nullopt;
  const MapReader keys(
      *value, scene.path("camera"),
      {"size_px", "focal_px", "centre_px", "distortion", "position_m", "rpy_deg", "webcam"},
      faults);
  CameraConfig camera;
  if (const auto size = keys.numbers("size_px", 2, kPixels)) {
    camera.model.width = static_cast<int>((*size)[0]);
    camera.model.height = static_cast<int>((*size)[1]);
    const double pixels = (*size)[0] * (*size)[1];
    if (pixels > vision::JpegDecoder::kMaxPixels) {
      keys.complain("size_px", "makes " + formatNumber(pixels) + " pixels; expected at most " +
                                   formatNumber(vision::JpegDecoder::kMaxPixels));
    }
  }
  if (const auto focal = keys.numbers("focal_px", 2, kFocalLength)) {
    camera.model.fx = (*focal)[0];
    camera.model.fy = (*focal)[1];
  }
  if (const auto centre = keys.numbers("centre_px", 2, kPixelCoordinate)) {
    camera.model.cx = (*centre)[0];
    camera.model.cy = (*centre)[1];
  }
  camera.model.distortion = readDistortion(keys);
  keys.required("position_m", "the position of the camera in the world [m]");
  keys.required("rpy_deg", "the rotation of its frame, whose x axis is the optical axis [degrees]");
  camera.X_WC = readPose(keys, kPlace);
  camera.X_WC.rotation *= kOpticalInBody;
  if (const Value* webcam = value->find("webcam")) {
    camera.webcam = readWebcam(*webcam, keys.path("webcam"), camera.model, faults);
  }
  return camera;
}

namespace {

const NumberRule kAlongSection{"a number from 0 to 1", [](double s) { return s >= 0 && s <= 1; }};

bool wholeAndNotNegative(double x) { return x >= 0 && x == std::floor(x); }
const NumberRule kTagId{"a whole number >= 0", wholeAndNotNegative, 0, 1e6};

// A wider prior has no effect.
const NumberRule kPlacementShift = within(kPositive, 1e-6, 0.1, " m");
const NumberRule kPlacementTurn = within(kPositive, 1e-4, 90, " degrees");

// The frame of a group's poses: a section, and the frame of an actuator or (default) of the base
// curve.
struct Mount {
  int section = 0;
  std::optional<int> actuator;  // its index in the arm
};

// Index of the choice that a key names.
std::optional<int> indexOf(const MapReader& group, const std::string& key,
                           const std::vector<std::string>& names) {
  const std::optional<std::string> name = group.choice(key, names);
  if (!name) return std::nullopt;
  return static_cast<int>(std::find(names.begin(), names.end(), *name) - names.begin());
}

// Invalid keys were reported; the mount then has default values.
Mount readMount(const MapReader& group, const ArmParts& parts) {
  Mount mount;
  if (group.has("section")) {
    std::vector<std::string> sections;
    for (const SectionLook& look : parts.looks) sections.push_back(look.name);
    const std::optional<int> section = indexOf(group, "section", sections);
    if (!section) return mount;
    mount.section = *section;
  }
  if (group.has("actuator")) {
    std::vector<std::string> actuators;
    const int first = parts.arm.firstActuator(mount.section);
    for (int i = first; i < parts.arm.firstActuator(mount.section + 1); ++i) {
      actuators.push_back(parts.arm.actuator(i).name);
    }
    const std::optional<int> actuator = indexOf(group, "actuator", actuators);
    if (actuator) mount.actuator = first + *actuator;
  }
  return mount;
}

void readGroup(const MapReader& group, const std::string& family, int family_size,
               const ArmParts* arm, estimation::TagLayout& layout) {
  const auto ids = group.numbers("ids", 0, kTagId);
  const auto s = group.numbers("s", 0, kAlongSection);
  const lie::SE3 X_MT = readPose(group, kCoordinate);
  const Mount mount = arm ? readMount(group, *arm) : Mount();
  if (!ids) return;
  if (ids->empty()) group.complain("ids", "is empty; expected at least one tag");
  if (s && ids->size() != s->size()) {
    group.complain("s", "has " + std::to_string(s->size()) + " entries; expected " +
                            std::to_string(ids->size()) + ", one per id");
  }
  for (std::size_t i = 0; i < ids->size(); ++i) {
    const int id = static_cast<int>((*ids)[i]);
    if (id >= family_size) {
      group.complain("ids", "has " + std::to_string(id) + "; expected 0 to " +
                                std::to_string(family_size - 1) + ", the tags of " + family);
    }
    if (layout.find(id) >= 0) {
      group.complain("ids", "places tag " + std::to_string(id) + " again; expected distinct ids");
    }
    // A tag without s still counts, since its id is used.
    const double at = s && i < s->size() ? (*s)[i] : 0.0;
    const lie::SE3 X_SM =
        mount.actuator ? model::poseAlong(arm->arm.actuator(*mount.actuator), at) : lie::SE3();
    layout.tags.push_back({id, mount.section, at, X_SM * X_MT});
  }
}

}  // namespace

std::optional<TagParts> readTags(const MapReader& scene, const Value& document, const ArmParts* arm,
                                 FaultList& faults) {
  const Value* value = document.find("tags");
  if (value == nullptr) return std::nullopt;
  const MapReader tags(*value, scene.path("tags"),
                       {"family", "size_m", "placement_prior", "frame", "groups"}, faults);
  TagParts parts{vision::DetectorConfig().family, {}, {}, {}};
  if (tags.has("family")) {
    parts.family = tags.choice("family", vision::TagFamily::names()).value_or(parts.family);
  }
  parts.layout.size = tags.number("size_m", kLength).value_or(0.0);
  if (const Value* given = value->find("placement_prior")) {
    const MapReader prior(*given, tags.path("placement_prior"), {"translation_m", "rotation_deg"},
                          faults);
    parts.prior.translation =
        prior.number("translation_m", kPlacementShift, parts.prior.translation);
    if (const auto deg = prior.optionalNumber("rotation_deg", kPlacementTurn)) {
      parts.prior.rotation = radians(*deg);
    }
  }
  if (const Value* frame = value->find("frame")) {
    parts.X_BF = readPose(MapReader(*frame, tags.path("frame"), {"position_m", "rpy_deg"}, faults),
                          kCoordinate);
  }
  const std::vector<Value::Entry>* groups = tags.list("groups");
  if (groups == nullptr) return std::nullopt;
  const int family_size = vision::TagFamily(parts.family).count();
  for (std::size_t i = 0; i < groups->size(); ++i) {
    const MapReader group((*groups)[i].value, indexPath(tags.path("groups"), i),
                          {"section", "actuator", "ids", "s", "position_m", "rpy_deg"}, faults);
    readGroup(group, parts.family, family_size, arm, parts.layout);
  }
  if (parts.layout.tags.size() > static_cast<std::size_t>(estimation::kMaxTags)) {
    tags.complain("groups", "place " + std::to_string(parts.layout.tags.size()) +
                                " tags; expected at most " + std::to_string(estimation::kMaxTags));
  }
  return parts;
}

namespace {

const NumberRule kDecimation{"a finite value >= 1", [](double x) { return x >= 1; }, 1, 16};
const NumberRule kBlur = within(kFinite, -10, 10, " px");
const NumberRule kCornerNoise = within(kPositive, 1e-3, 100, " px");
const NumberRule kSmallLength = within(kPositive, 1e-6, 1, " m");
const NumberRule kAngleNoise = within(kNotNegative, 0, 180, " degrees");
const NumberRule kSmallAngle = within(kPositive, 1e-4, 180, " degrees");
const NumberRule kRobustScale = within(kPositive, 0.1, 1e6);

vision::TrackingMode readTracking(const MapReader& keys, vision::TrackingMode fallback) {
  using vision::TrackingMode;
  if (!keys.has("tracking")) return fallback;
  const auto name = keys.choice("tracking", {"edges", "regions", "full"});
  if (name == "edges") return TrackingMode::kEdges;
  if (name == "regions") return TrackingMode::kRegions;
  return TrackingMode::kFull;
}

void readDetector(const MapReader& keys, vision::DetectorConfig& detector) {
  detector.quad_decimate = keys.number("quad_decimate", kDecimation, detector.quad_decimate);
  detector.quad_sigma = keys.number("quad_sigma_px", kBlur, detector.quad_sigma);
  detector.threads = static_cast<int>(keys.integer("threads", 1, 64, detector.threads));
  detector.refine_edges = keys.truth("refine_edges", detector.refine_edges);
  detector.max_hamming = static_cast<int>(keys.integer("max_hamming", 0, 3, detector.max_hamming));
}

void readFit(const MapReader& keys, const Value& value, estimation::TwistFitOptions& fit,
             FaultList& faults) {
  fit.corner_noise = keys.number("corner_noise_px", kCornerNoise, fit.corner_noise);
  fit.position_noise = keys.number("tag_position_noise_m", kSmallLength, fit.position_noise);
  if (const auto deg = keys.optionalNumber("tag_rotation_noise_deg", kAngleNoise)) {
    fit.rotation_noise = radians(*deg);
  }
  fit.robust_scale = keys.number("robust_scale", kRobustScale, fit.robust_scale);
  if (const Value* given = value.find("base_prior")) {
    const MapReader prior(*given, keys.path("base_prior"), {"translation_m", "rotation_deg"},
                          faults);
    fit.free_base = true;
    fit.base_prior.translation =
        prior.number("translation_m", kSmallLength, fit.base_prior.translation);
    if (const auto deg = prior.optionalNumber("rotation_deg", kSmallAngle)) {
      fit.base_prior.rotation = radians(*deg);
    }
  }
  if (const auto bleed = keys.optionalNumber("bleed_prior_m", kSmallLength)) {
    fit.free_bleed = true;
    fit.bleed_prior = *bleed;
  }
}

void readKeys(const MapReader& keys, const Value& value, vision::LocalizerConfig& config,
              FaultList& faults) {
  readDetector(keys, config.detector);
  config.tracking = readTracking(keys, config.tracking);
  config.min_tags =
      static_cast<int>(keys.integer("min_tags", 2, estimation::kMaxTags, config.min_tags));
  readFit(keys, value, config.fit, faults);
}

}  // namespace

vision::LocalizerConfig readVision(const MapReader& scene, const Value& document,
                                   const std::string& family, FaultList& faults) {
  vision::LocalizerConfig config;
  if (!family.empty()) config.detector.family = family;
  const std::size_t faults_before = faults.count();
  if (const Value* value = document.find("vision")) {
    readKeys(MapReader(*value, scene.path("vision"),
                       {"quad_decimate", "quad_sigma_px", "threads", "refine_edges", "max_hamming",
                        "tracking", "min_tags", "corner_noise_px", "tag_position_noise_m",
                        "tag_rotation_noise_deg", "robust_scale", "base_prior", "bleed_prior_m"},
                       faults),
             *value, config, faults);
  }
  if (faults.count() != faults_before) return config;
  try {
    config.detector.validate();
  } catch (const std::invalid_argument& error) {
    scene.complain("vision", std::string("does not configure a tag detector: ") + error.what());
  }
  return config;
}

namespace {

const NumberRule kStiffnessScale = within(kPositive, 1e-3, 1e3);
const NumberRule kLengthScale = within(kPositive, 0.5, 2);
const NumberRule kMountTranslation = within(kNotNegative, 0, 1, " m");
const NumberRule kMountRotation = within(kNotNegative, 0, 45, " degrees");
const NumberRule kCameraBlur = within(kNotNegative, 0, 100, " px");
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
  camera.blur = keys.number("blur_px", kCameraBlur, camera.blur);
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

namespace {

const NumberRule kFollowTime = within(kPositive, 1e-3, 3600, " s");
const NumberRule kMode = within(kPositive, 0.01, 1000, " Hz");
const NumberRule kDamping = within(kPositive, 1e-3, 1);
const NumberRule kPart = within(kNotNegative, 0, 1);
const NumberRule kCreep = within(kNotNegative, 0, 100, " per square root of a second");
const NumberRule kBiasTranslation = within(kPositive, 1e-6, 1, " m");
const NumberRule kBiasRotation = within(kPositive, 1e-4, 180, " degrees");
const NumberRule kContactLimit = within(kPositive, 1, 1e6);
const NumberRule kReadingNoise = within(kPositive, 1e-3, 100, " kPa");

constexpr double kUsualDamping = 0.1;        // of muscles and bellows
constexpr double kHardwareNoise = 2e3;       // [Pa]
constexpr double kLeastReadingNoise = 10.0;  // of a simulated regulator without noise [Pa]
constexpr double kWatchedCreep = 0.1;  // relative to the creep, in the filter that detects loads

double usualNoise(const std::optional<regulator::Config>& regulator) {
  const auto* simulated =
      regulator ? std::get_if<regulator::SimulatedRegulatorConfig>(&*regulator) : nullptr;
  return simulated != nullptr ? std::max(simulated->noise, kLeastReadingNoise) : kHardwareNoise;
}

// Times derived from the arm's vibration; a given smoothing time must be long enough.
void readVibration(const MapReader& keys, follow::VisualServoConfig& loop) {
  const auto given = keys.optionalNumber("smoothing_s", kFollowTime);
  loop.smoothing = given.value_or(loop.smoothing);
  const double damping = keys.number("mode_damping", kDamping, kUsualDamping);
  if (!keys.has("mode_hz")) {
    if (keys.has("mode_damping")) {
      keys.complain("mode_damping", "is given without mode_hz; expected both or none");
    }
    return;
  }
  const auto frequency = keys.optionalNumber("mode_hz", kMode);
  if (!frequency) return;
  loop.filter.settling_time = 1 / (2 * basics::kPi * *frequency * damping);
  const double least = follow::smoothingFor(*frequency, damping, loop.time_constant);
  if (given && *given < least) {
    keys.fault("smoothing_s", "at least " + formatNumber(std::ceil(100 * least) / 100) +
                                  " s, or the loop excites an arm with this mode_hz and "
                                  "mode_damping; leave out smoothing_s to use that value");
  }
  loop.smoothing = std::max(loop.smoothing, least);
}

void readFilter(const MapReader& keys, follow::VisualServoConfig& loop) {
  estimation::ArmFilterOptions& filter = loop.filter;
  filter.hysteresis = keys.number("hysteresis", kPart, filter.hysteresis);
  if (const auto creep = keys.optionalNumber("creep", kCreep)) {
    filter.creep = *creep;
    loop.watch_creep = kWatchedCreep * *creep;
  }
  filter.bias_translation =
      keys.number("bias_translation_m", kBiasTranslation, filter.bias_translation);
  if (const auto deg = keys.optionalNumber("bias_rotation_deg", kBiasRotation)) {
    filter.bias_rotation = radians(*deg);
  }
  if (const auto kpa = keys.optionalNumber("reading_noise_kpa", kReadingNoise)) {
    loop.reading_noise = pascals(*kpa);
  }
}

void readContact(const MapReader& keys, follow::VisualServoConfig& loop) {
  loop.contact.limit = keys.number("contact_limit", kContactLimit, loop.contact.limit);
  if (!keys.has("on_contact")) return;
  std::vector<std::string> words;
  for (const follow::OnContact reaction : follow::kContactReactions) {
    words.emplace_back(nameOf(reaction));
  }
  const auto word = keys.choice("on_contact", words);
  for (const follow::OnContact reaction : follow::kContactReactions) {
    if (word == nameOf(reaction)) loop.on_contact = reaction;
  }
}

}  // namespace

follow::VisualServoConfig readFollow(const MapReader& scene, const Value& document,
                                     const SafetyConfig& safety,
                                     const std::optional<regulator::Config>& regulator,
                                     FaultList& faults) {
  follow::VisualServoConfig loop{};
  loop.time_constant = safety.rules.time_constant;
  loop.reading_noise = usualNoise(regulator);
  const bool hardware = regulator && regulator::isHardware(*regulator);
  if (hardware) loop.on_contact = follow::OnContact::kYield;
  const Value* value = document.find("follow");
  if (value == nullptr) return loop;
  const MapReader keys(*value, scene.path("follow"),
                       {"smoothing_s", "mode_hz", "mode_damping", "stale_s", "coast_s",
                        "hysteresis", "creep", "bias_translation_m", "bias_rotation_deg",
                        "on_contact", "contact_limit", "reading_noise_kpa"},
                       faults);
  readVibration(keys, loop);
  loop.stale_after = keys.number("stale_s", kFollowTime, loop.stale_after);
  loop.coast_time = keys.number("coast_s", kFollowTime, loop.coast_time);
  readFilter(keys, loop);
  readContact(keys, loop);
  return loop;
}

}  // namespace helix_arm::io
