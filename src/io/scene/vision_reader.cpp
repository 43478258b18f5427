#include <algorithm>
#include <cmath>
#include <stdexcept>

#include "helix_arm/vision/tag_detector.hpp"
#include "io/document/number.hpp"
#include "scene_readers.hpp"
#include "vision/jpeg.hpp"

namespace helix_arm::io {

const Eigen::Matrix3d kOpticalInBody =
    (Eigen::Matrix3d() << 0, 0, 1, -1, 0, 0, 0, -1, 0).finished();

namespace {

constexpr NumberRule kPixels{"a whole number > 0",
                             [](double x) { return x > 0 && x == std::floor(x); }, 1, 20000, " px"};

void readDistortion(const MapReader& camera, std::array<double, 8>& distortion) {
  const auto given = camera.read("distortion", Numbers{within(kFinite, -1e4, 1e4)});
  if (!given) return;
  if (given->size() != 4 && given->size() != 5 && given->size() != 8) {
    return camera.complainOfSize("distortion", given->size(), "4, 5 or 8: k1 k2 p1 p2 k3 k4 k5 k6");
  }
  std::copy(given->begin(), given->end(), distortion.begin());
}

constexpr NumberRule kTagId{"a whole number >= 0",
                            [](double x) { return x >= 0 && x == std::floor(x); }, 0, 1e6};

// The frame of a group's poses: that of a section's actuator, by default of its base curve.
struct Mount {
  int section = 0;
  const model::Actuator* actuator = nullptr;
};

// Invalid keys were reported; the mount then has default values.
Mount readMount(const MapReader& group, const ArmParts& parts) {
  Mount mount;
  if (group.has("section")) {
    const std::optional<int> section = group.read("section", sectionsOf(parts));
    if (!section) return mount;
    mount.section = *section;
  }
  OneOf<const model::Actuator*> actuators;
  for (int i = parts.arm.firstActuator(mount.section);
       i < parts.arm.firstActuator(mount.section + 1); ++i) {
    actuators.words.emplace_back(parts.arm.actuator(i).name, &parts.arm.actuator(i));
  }
  Key("actuator", actuators, mount.actuator).read(group);
  return mount;
}

void readGroup(const MapReader& group, const lie::SE3& X_MT, const vision::TagFamily& family,
               const ArmParts* arm, estimation::TagLayout& layout) {
  const auto ids = group.read("ids", Numbers{kTagId});
  const auto s = group.read("s", Numbers{kFraction});
  const Mount mount = arm ? readMount(group, *arm) : Mount();
  if (!ids) return;
  if (ids->empty()) group.complain("ids", "is empty; expected at least one tag");
  if (s && ids->size() != s->size()) {
    group.complainOfSize("s", s->size(), ids->size(), ", one per id");
  }
  for (std::size_t i = 0; i < ids->size(); ++i) {
    const int id = static_cast<int>((*ids)[i]);
    if (id >= family.count()) {
      group.complain("ids", "has ", id, "; expected 0 to ", family.count() - 1, ", the tags of ",
                     family.name());
    }
    if (layout.find(id) >= 0) {
      group.complain("ids", "places tag ", id, " again; expected distinct ids");
    }
    // A tag without s still counts, since its id is used.
    const double at = s && i < s->size() ? (*s)[i] : 0.0;
    const lie::SE3 X_SM = mount.actuator ? model::poseAlong(*mount.actuator, at) : lie::SE3();
    layout.tags.push_back({id, mount.section, at, X_SM * X_MT});
  }
}

constexpr NumberRule kSmallLength = within(kPositive, 1e-6, 1, " m");
constexpr NumberRule kSmallAngle = within(kPositive, 1e-4, 180, " degrees");

// @param least_tags  2, as the pose of a single tag is ambiguous; 1 of bodies.
std::vector<Key> visionKeys(vision::LocalizerConfig& config, int least_tags) {
  constexpr NumberRule kDecimation{"a finite value >= 1", [](double x) { return x >= 1; }, 1, 16};
  using vision::TrackingMode;
  const OneOf<TrackingMode> kTracking{{{"edges", TrackingMode::kEdges},
                                       {"regions", TrackingMode::kRegions},
                                       {"full", TrackingMode::kFull}}};
  vision::DetectorConfig& detector = config.detector;
  estimation::TwistFitOptions& fit = config.fit;
  return {{"quad_decimate", kDecimation, detector.quad_decimate},
          {"quad_sigma_px", within(kFinite, -10, 10, " px"), detector.quad_sigma},
          {"threads", Whole{1, 64}, detector.threads},
          {"refine_edges", detector.refine_edges},
          {"max_hamming", Whole{0, 3}, detector.max_hamming},
          {"tracking", kTracking, config.tracking},
          {"min_tags", Whole{least_tags, estimation::kMaxTags}, config.min_tags},
          {"corner_noise_px", within(kPositive, 1e-3, 100, " px"), fit.corner_noise},
          {"tag_position_noise_m", kSmallLength, fit.position_noise},
          {"tag_rotation_noise_deg", within(kNotNegative, 0, 180, " degrees"), fit.rotation_noise,
           kDegree},
          {"robust_scale", within(kPositive, 0.1, 1e6), fit.robust_scale},
          {"base_prior",
           {{"translation_m", kSmallLength, fit.base_prior.translation},
            {"rotation_deg", kSmallAngle, fit.base_prior.rotation, kDegree}}},
          {"bleed_prior_m", kSmallLength, fit.border_shift_prior}};
}

std::vector<Key> motionKeys(dynamics::MotionConfig& config) {
  return {{"damping_s", dampingKeys(config.damping)},
          {"inertia_radius_m", kLength, config.inertia_radius},
          {"step_s", within(kPositive, 1e-6, 0.1, " s"), config.step}};
}

constexpr double kUsualDamping = 0.1;  // of muscles and bellows
constexpr NumberRule kStiffnessScale = within(kPositive, 1e-3, 1e3);
constexpr NumberRule kScaleOfLength = within(kPositive, 0.5, 2);
constexpr NumberRule kMountTranslation = within(kNotNegative, 0, 1, " m");
constexpr NumberRule kMountRotation = within(kNotNegative, 0, 45, " degrees");

// @param arm   null if it has faults. @param load  of the scene; null without.
void readInertia(const MapReader& rig, const std::string& key, const ArmParts* arm,
                 const statics::Load* load, simulation::ArmInertia& inertia) {
  std::vector<Key> rows = motionKeys(inertia.motion);
  rows.insert(rows.begin(), {{"mass_kg", within(kPositive, 1e-6, 1e3, " kg"), inertia.mass},
                             {"K_eps_n", within(kPositive, 1e-3, 1e7, " N"), inertia.K_eps}});
  const auto keys = rig.map(key, rows);
  if (!keys || arm == nullptr || !keys->isSound()) return;
  const auto none = [](double mass) { return !(mass > 0); };
  const bool has_masses =
      load != nullptr && std::none_of(load->mass.begin(), load->mass.end(), none);
  if (!inertia.mass && !has_masses) {
    keys->fault("mass_kg", "the mass of the arm [kg], as the scene has no load.mass_kg");
  }
  if (!inertia.K_eps && load == nullptr) {
    keys->fault("K_eps_n", "the extensional stiffness of an actuator [N], as the scene has no ",
                "arm.stiffness.K_eps_n");
  }
  if (!arm->arm.isLinear() || (load != nullptr && !load->tables.empty())) {
    rig.complain(key,
                 "needs sections without taper, and stiffness that does not depend on "
                 "pressure; leave it out");
  }
}

// @param arm_parts  null if the arm has faults: the number of scales is then not checked.
std::vector<Key> deviationKeys(simulation::ArmDeviation& arm, const ArmParts* arm_parts,
                               const statics::Load* load, const dynamics::MotionConfig& usual) {
  const std::size_t actuators = arm_parts == nullptr ? 0 : arm_parts->arm.actuatorCount();
  const Numbers lengths{kScaleOfLength, actuators}, stiffnesses{kStiffnessScale, actuators};
  return {{"K_gamma_scale", kStiffnessScale, arm.K_gamma_scale},
          {"K_kappa_scale", kStiffnessScale, arm.K_kappa_scale},
          {"length_scale", kScaleOfLength, arm.length_scale},
          {"length_scales", lengths, arm.length_scales},
          {"K_eps_scale", kStiffnessScale, arm.K_eps_scale},
          {"stroke_scales", lengths, arm.stroke_scales},
          {"stiffness_scales", stiffnesses, arm.stiffness_scales},
          {"dead_time_s", within(kNotNegative, 0, 1, " s"), arm.dead_time},
          {"dynamics",
           [=, &arm](const MapReader& keys, const std::string& key) {
             arm.inertia = simulation::ArmInertia{usual, std::nullopt, std::nullopt};
             arm.inertia->motion.order = 0;
             readInertia(keys, key, arm_parts, load, *arm.inertia);
           }},
          {"response", [&arm](const MapReader& keys, const std::string& key) {
             arm.response = readResponse(keys, key);
           }}};
}

constexpr NumberRule kFollowTime = within(kPositive, 1e-3, 3600, " s");

constexpr double kHardwareNoise = 2e3;       // [Pa]
constexpr double kLeastReadingNoise = 10.0;  // of a simulated regulator without noise [Pa]
constexpr double kFastestMode = 8.0;         // that pictures resolve [Hz]
constexpr double kWatchedCreep = 0.1;  // relative to the creep, in the filter that detects loads

double usualNoise(const std::optional<regulator::Config>& regulator) {
  const auto* simulated =
      regulator ? std::get_if<regulator::SimulatedRegulatorConfig>(&*regulator) : nullptr;
  return simulated != nullptr ? std::max(simulated->noise, kLeastReadingNoise) : kHardwareNoise;
}

// Times derived from the arm's vibration. @return the least smoothing time that does not excite it.
double setVibration(const dynamics::Vibration& vibration, follow::VisualServoConfig& loop) {
  const auto [frequency, damping] = vibration;
  if (frequency < kFastestMode) loop.mode = estimation::Mode{frequency, damping};
  loop.filter.settling_time = 1 / (2 * basics::kPi * frequency * damping);
  const double least = follow::smoothingFor(frequency, damping, loop.time_constant);
  loop.smoothing = std::max(loop.smoothing, least);
  return least;
}

}  // namespace

std::vector<Key> dampingKeys(dynamics::StrainTimes& damping) {
  constexpr NumberRule kDamping = within(kNotNegative, 0, 1e3, " s");
  return {{"stretch", kDamping, damping.stretch},
          {"shear", kDamping, damping.shear},
          {"twist", kDamping, damping.twist},
          {"bend", kDamping, damping.bend}};
}

std::optional<CameraConfig> readCamera(const MapReader& scene) {
  CameraConfig camera;
  constexpr Whole kDriverUnits{0, 1'000'000};
  estimation::Camera& model = camera.model;
  vision::WebcamConfig webcam;
  Eigen::Vector2d size(0, 0), focal(0, 0), centre(0, 0);
  const auto keys = scene.map(
      "camera", {Key("size_px", kPixels, size).required(),
                 Key("focal_px", within(kPositive, 1, 1e6, " px"), focal).required(),
                 Key("centre_px", within(kFinite, -1e5, 1e5, " px"), centre).required(),
                 {"distortion", [&](const MapReader& map,
                                    const std::string&) { readDistortion(map, model.distortion); }},
                 "position_m",
                 "rpy_deg",
                 {"webcam",
                  {{"device", Text{"the path of a device"}, webcam.device},
                   {"fourcc", oneOf({"MJPG", "YUYV", "UYVY", "GREY"}), webcam.fourcc},
                   {"fps", within(kPositive, 0.01, 1000, " Hz"), webcam.fps},
                   {"focus", kDriverUnits, webcam.focus},
                   {"exposure", kDriverUnits, webcam.exposure}}}});
  if (!keys) return std::nullopt;
  if (size.prod() > vision::JpegDecoder::kMaxPixels) {
    keys->complain("size_px", "makes ", formatNumber(size.prod()), " pixels; expected at most ",
                   formatNumber(vision::JpegDecoder::kMaxPixels));
  }
  model.width = static_cast<int>(size.x());
  model.height = static_cast<int>(size.y());
  std::tie(model.fx, model.fy) = std::pair(focal.x(), focal.y());
  std::tie(model.cx, model.cy) = std::pair(centre.x(), centre.y());
  keys->required("position_m", "the position of the camera in the world [m]");
  keys->required("rpy_deg",
                 "the rotation of its frame, whose x axis is the optical axis [degrees]");
  // A camera farther away than this was given in mm.
  for (const Key& key : poseKeys(camera.X_WC, within(kFinite, -100, 100, " m"))) key.read(*keys);
  camera.X_WC.rotation *= kOpticalInBody;
  webcam.width = model.width;
  webcam.height = model.height;
  if (keys->has("webcam")) camera.webcam = webcam;
  return camera;
}

std::optional<TagParts> readTags(const MapReader& scene, const ArmParts* arm) {
  TagParts parts{vision::DetectorConfig().family, {}, {}, {}};
  const auto tags = scene.map(
      "tags",
      {{"family", oneOf(vision::TagFamily::names()), parts.family},
       Key("size_m", kLength, parts.layout.size).required(),
       // A wider prior has no effect.
       {"placement_prior",
        {{"translation_m", within(kPositive, 1e-6, 0.1, " m"), parts.prior.translation},
         {"rotation_deg", within(kPositive, 1e-4, 90, " degrees"), parts.prior.rotation, kDegree}}},
       {"frame", poseKeys(parts.X_BF, kCoordinate)},
       "groups"});
  if (!tags) return std::nullopt;
  const vision::TagFamily family(parts.family);
  const bool listed = tags->eachOf("groups", [&](const Value& value, const std::string& path) {
    lie::SE3 X_MT;
    const std::vector<Key> pose = poseKeys(X_MT, kCoordinate);
    const MapReader group(value, path, {"section", "actuator", "ids", "s", pose[0], pose[1]},
                          scene.faults());
    readGroup(group, X_MT, family, arm, parts.layout);
  });
  if (!listed) return std::nullopt;
  if (parts.layout.tags.size() > static_cast<std::size_t>(estimation::kMaxTags)) {
    tags->complain("groups", "place ", parts.layout.tags.size(), " tags; expected at most ",
                   estimation::kMaxTags);
  }
  return parts;
}

MotionCapture readMotionCapture(const MapReader& scene) {
  MotionCapture out;
  lie::SE3 X_BF;
  Eigen::Vector3d body(0, 0, 0), place(0, 0, 0);
  Eigen::Vector2d beam(0, 0);
  const auto keys =
      scene.map("motion_capture", {{"frame", poseKeys(X_BF, kCoordinate)},
                                   {"body_rpy_deg", kFinite, body},
                                   {"body_position_m", kCoordinate, place},
                                   {"beam_deg", within(kFinite, -80, 80, " degrees"), beam}});
  if (!keys) return out;
  if (keys->has("frame")) out.X_BF = X_BF;
  if (keys->has("body_rpy_deg")) out.R_TM = rotationOfRpyDeg(body);
  if (keys->has("body_position_m")) out.p_TM = place;
  if (keys->has("beam_deg")) out.beam = beam * (basics::kPi / 180);
  return out;
}

vision::LocalizerConfig readVision(const MapReader& scene, const std::string& family) {
  vision::LocalizerConfig config;
  if (!family.empty()) config.detector.family = family;
  const int least_tags = scene.has("bodies") ? 1 : config.min_tags;
  config.min_tags = least_tags;
  if (const auto keys = scene.map("vision", visionKeys(config, least_tags))) {
    config.fit.free_base = keys->has("base_prior");
    config.fit.free_border_shift = keys->has("bleed_prior_m");
    if (!keys->isSound()) return config;
  }
  try {
    config.detector.validate();
  } catch (const std::invalid_argument& error) {
    scene.complain("vision", "does not configure a tag detector: ", error.what());
  }
  return config;
}

dynamics::MotionConfig readDynamics(const MapReader& scene) {
  dynamics::MotionConfig config;
  std::vector<Key> keys = motionKeys(config);
  keys.emplace_back("order", Whole{0, dynamics::kMostOrder}, config.order);
  scene.map("dynamics", keys);
  return config;
}

SimulationConfig readSimulation(const MapReader& scene, const ArmParts* arm,
                                const statics::Load* load, const dynamics::MotionConfig& usual) {
  SimulationConfig config;
  auto& [deviation, mounts, camera, bodies] = config;
  scene.map("simulation",
            {{"arm", deviationKeys(deviation, arm, load, usual)},
             {"mounts",
              {{"camera_translation_m", kMountTranslation, mounts.camera_translation},
               {"camera_rotation_deg", kMountRotation, mounts.camera_rotation, kDegree},
               {"tag_translation_m", kMountTranslation, mounts.tag_translation},
               {"tag_rotation_deg", kMountRotation, mounts.tag_rotation, kDegree},
               {"seed", kSeed, mounts.seed}}},
             {"camera",
              {{"blur_px", within(kNotNegative, 0, 100, " px"), camera.blur},
               {"noise_gray_levels", within(kNotNegative, 0, 255, " gray levels"), camera.noise},
               {"exposure", within(kPositive, 1e-3, 1e3), camera.exposure},
               {"bleed_m", within(kNotNegative, 0, 0.1, " m"), camera.border_shift},
               {"jpeg_quality", Whole{1, 100}, camera.jpeg_quality},
               {"clutter", Whole{0, 10000}, camera.clutter},
               {"occluders", Whole{0, 1000}, camera.occluders},
               {"seed", kSeed, camera.seed}}},
             {"bodies",
              {{"rate_hz", within(kPositive, 1, 250, " Hz"), bodies.rate},
               {"lost", within(kNotNegative, 0, 0.99), bodies.lost},
               {"seed", kSeed, bodies.seed}}}});
  return config;
}

follow::VisualServoConfig readFollow(const MapReader& scene, const SafetyConfig& safety,
                                     const std::optional<regulator::Config>& regulator,
                                     const std::optional<dynamics::Vibration>& slowest) {
  follow::VisualServoConfig loop{};
  loop.time_constant = safety.rules.time_constant;
  for (const control::ChannelRules& channel : safety.channels) {
    loop.slew = std::min(loop.slew, channel.slew);
  }
  loop.reading_noise = usualNoise(regulator);
  estimation::ArmFilterOptions& filter = loop.filter;
  std::optional<double> smoothing, frequency;
  double damping = kUsualDamping;
  const auto keys = scene.map(
      "follow",
      {{"smoothing_s", kFollowTime, smoothing},
       {"mode_hz", within(kPositive, 0.01, 1000, " Hz"), frequency},
       {"mode_damping", within(kPositive, 1e-3, 1), damping},
       {"stale_s", kFollowTime, loop.stale_after},
       {"coast_s", kFollowTime, loop.coast_time},
       {"hysteresis", within(kNotNegative, 0, 1), filter.hysteresis},
       {"creep", within(kNotNegative, 0, 100, " per square root of a second"), filter.creep},
       {"bias_translation_m", kSmallLength, filter.bias_translation},
       {"bias_rotation_deg", kSmallAngle, filter.bias_rotation, kDegree},
       {"prefer",
        OneOf<statics::Preference>{{{"min-change", statics::Preference::kMinChange},
                                    {"min-pressure", statics::Preference::kMinPressure}}},
        loop.preference},
       {"on_contact", oneOfNamed(follow::kContactReactions), loop.on_contact},
       {"yield_timeout_s", kFollowTime, loop.yield_timeout},
       {"contact_limit", within(kPositive, 1, 1e6), loop.contact.limit},
       {"reading_noise_kpa", within(kPositive, 1e-3, 100, " kPa"), loop.reading_noise, kKilo}});
  loop.smoothing = smoothing.value_or(loop.smoothing);
  const std::optional<dynamics::Vibration> vibration =
      frequency ? dynamics::Vibration{*frequency, damping} : slowest;
  const double least = vibration ? setVibration(*vibration, loop) : 0.0;
  if (!keys) return loop;
  if (smoothing && *smoothing < least) {
    keys->fault("smoothing_s", "at least ", formatNumber(std::ceil(100 * least) / 100),
                " s, or the loop excites an arm of ",
                formatNumber(std::round(100 * vibration->frequency) / 100),
                " Hz with a damping ratio of ",
                formatNumber(std::round(1000 * vibration->damping) / 1000),
                "; leave out smoothing_s to use that value");
  }
  if (keys->has("mode_damping") && !keys->has("mode_hz")) {
    keys->complain("mode_damping", "is given without mode_hz; expected both or none");
  }
  if (keys->has("creep")) loop.watch_creep = kWatchedCreep * filter.creep;
  return loop;
}

}  // namespace helix_arm::io
