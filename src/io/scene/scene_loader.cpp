#include <algorithm>
#include <exception>
#include <filesystem>

#include "helix_arm/basics/requirement.hpp"
#include "helix_arm/dynamics/arm_motion.hpp"
#include "helix_arm/statics/loaded.hpp"
#include "io/document/atomic_file.hpp"
#include "scene_readers.hpp"
#include "simulation/rig.hpp"

namespace helix_arm::io {

namespace {

// Files that the scene names relative to its folder.
std::vector<Value*> relativePaths(Value& document) {
  std::vector<Value*> out = relativeMeshes(document);
  if (Value* profile = relativeProfile(document)) out.push_back(profile);
  return out;
}

// How well a calibration knows the tags that it placed. One that is not in it, such as a tag that
// was added later, is as one that no capture showed. The base tag is where the scene says.
void takeErrors(const Provenance& calibration, const estimation::TagPrior& prior,
                estimation::TagLayout& layout) {
  const auto errorOf = [&](const estimation::TagPlacement& tag) {
    return calibration.errorOf(estimation::FitParameter::kTags, "_" + std::to_string(tag.id));
  };
  const auto isIn = [&](const auto& tag) { return errorOf(tag).has_value(); };
  if (std::none_of(layout.tags.begin(), layout.tags.end(), isIn)) return;
  Provenance::PlacementError unseen{lie::Vector6::Zero(), false};
  unseen.deviations.head<3>().setConstant(prior.translation);
  unseen.deviations.tail<3>().setConstant(prior.rotation);
  for (int i = 0; i < static_cast<int>(layout.tags.size()); ++i) {
    if (i == layout.baseTag()) continue;
    estimation::TagPlacement& tag = layout.tags[static_cast<std::size_t>(i)];
    const auto known = errorOf(tag).value_or(unseen);
    tag.error = known.deviations;
    tag.placed = known.seen;
  }
}

constexpr double kTypicalInput = 0.3;  // part of the limits

// The slowest vibration of the arm at typical pressures, where masses and damping tell it.
std::optional<dynamics::Vibration> slowestOf(const MapReader& scene, const ArmParts* arm,
                                             const statics::Load* load,
                                             const dynamics::MotionConfig& config) {
  const dynamics::StrainTimes& damping = config.damping;
  const auto has_mass = [](double mass) { return mass > 0; };
  if (arm == nullptr || load == nullptr || !(damping.bend + damping.twist + damping.shear > 0) ||
      std::none_of(load->mass.begin(), load->mass.end(), has_mass) || !arm->arm.isLinear() ||
      !load->tables.empty()) {
    return std::nullopt;
  }
  try {
    const dynamics::ArmMotion motion(arm->arm, arm->planar, *load, config);
    const auto found = dynamics::vibrationsOf(motion.linearisedAt(arm->arm.inputAt(kTypicalInput)));
    return found.empty() ? std::nullopt : std::optional(found.front());
  } catch (const std::exception& error) {
    scene.complain("dynamics", "tells no vibration of the arm: ", error.what());
    return std::nullopt;
  }
}

}  // namespace

SceneDocument readSceneDocument(const std::string& path, const std::vector<Override>& overrides,
                                FaultList& faults) {
  const std::string text = readSceneText(path, faults);
  Value document = parseScene(text, overrides, faults);
  for (Value* file : relativePaths(document)) {
    file->text = std::filesystem::absolute(path).parent_path() / file->text;
  }
  return {std::move(document), sha256Of(text)};
}

std::string sceneText(const std::string& path, const std::vector<Override>& overrides) {
  FaultList faults(path);
  if (overrides.empty()) {
    std::string text = readSceneText(path, faults);
    Value plain = parseScene(text, {}, faults);
    faults.throwIfAny();
    if (relativePaths(plain).empty()) return text;
  }
  const SceneDocument scene = readSceneDocument(path, overrides, faults);
  faults.throwIfAny();
  return writeDocument(scene.document);
}

std::optional<simulation::CameraSetup> Scene::cameraSetup() const {
  if (!isSeen()) return std::nullopt;
  std::vector<double> radii;
  for (const SectionLook& look : looks) radii.push_back(look.separator_radius);
  return simulation::CameraSetup{simulation::deviate(view(), arm, simulation.mounts),
                                 vision::TagFamily(vision.detector.family),
                                 {std::move(radii)},
                                 simulation.camera,
                                 simulation.bodies};
}

Scene loadScene(const std::string& path, const std::vector<Override>& overrides) {
  FaultList faults(path);
  SceneDocument read = readSceneDocument(path, overrides, faults);
  Scene scene = makeScene(read.document, faults);
  scene.sha256 = std::move(read.sha256);
  return scene;
}

Scene sceneOfText(const std::string& text, const std::string& name) {
  FaultList faults(name);
  const Value document = parseScene(text, {}, faults);
  faults.throwIfAny();
  return makeScene(document, faults);
}

Scene makeScene(const Value& document, FaultList& faults) {
  const MapReader keys(document, "", keysOf(sceneKind().keys), faults);
  auto [name, contractions, arm, model] = readSceneArm(keys);
  const ArmParts* const known_arm = arm ? &*arm : nullptr;
  std::optional<TagParts> tags = readTags(keys, known_arm);
  std::optional<estimation::TagLayout> bodies = readBodies(keys, known_arm);
  const MotionCapture motion_capture = readMotionCapture(keys);
  auto camera = readCamera(keys);
  vision::LocalizerConfig vision = readVision(keys, tags ? tags->family : std::string());
  const statics::Load* const load = model && model->load() ? &*model->load() : nullptr;
  const dynamics::MotionConfig dynamics = readDynamics(keys);
  SimulationConfig simulation = readSimulation(keys, known_arm, load, dynamics);
  auto regulator = readRegulator(keys, known_arm);
  SafetyConfig safety = readSafety(keys, known_arm, regulator);
  std::optional<clearance::KeepOut> keep_out = readKeepOut(keys, known_arm);
  const follow::VisualServoConfig follow =
      readFollow(keys, safety, regulator, slowestOf(keys, known_arm, load, dynamics));
  std::optional<Provenance> calibration = readProvenance(keys);
  faults.throwIfAny();
  Scene scene(std::move(*name), std::move(arm->arm), std::move(*model));
  for (const auto& [curve, contraction] : contractions) {
    scene.contractions[curve] = contraction->response;
  }
  scene.X_WB = arm->X_WB;
  scene.planar = std::move(arm->planar);
  scene.dynamics = dynamics;
  scene.keep_out = std::move(keep_out);
  scene.looks = std::move(arm->looks);
  scene.regulator = std::move(regulator);
  if (tags) {
    scene.tags = std::move(tags->layout);
    if (calibration) takeErrors(*calibration, tags->prior, *scene.tags);
    scene.tag_prior = tags->prior;
    scene.X_BF = tags->X_BF;
  }
  if (bodies) {
    if (calibration) takeErrors(*calibration, scene.tag_prior, *bodies);
    for (const estimation::TagPlacement& body : bodies->tags) {
      vision.fit.position_noise = body.noise->position;
      vision.fit.rotation_noise = body.noise->rotation;
    }
    scene.tags = std::move(bodies);
    scene.X_BF = motion_capture.X_BF.value_or(lie::SE3());
  }
  scene.motion_capture = motion_capture;
  scene.camera = std::move(camera);
  scene.vision = std::move(vision);
  const bool pulled_out = scene.model.load() && !statics::inPlane(*scene.model.load());
  scene.vision.fit.planar = scene.planar.has_value() && !pulled_out;
  scene.simulation = std::move(simulation);
  scene.safety = std::move(safety);
  scene.follow = follow;
  scene.calibration = std::move(calibration);
  return scene;
}

void requireSameRig(const Scene& at_hand, const Scene& next) {
  const model::Arm &now = at_hand.arm, &then = next.arm;
  const auto namesOf = [](const model::Arm& arm, int section) {
    std::string out;
    for (int i = arm.firstActuator(section); i < arm.firstActuator(section + 1); ++i) {
      out += (out.empty() ? "" : ", ") + arm.actuator(i).name;
    }
    return out;
  };
  const auto require = [&](bool holds, const auto&... what) {
    basics::require(holds, "scene ", next.name, " is not of the running rig: ", what...,
                    "; restart the nodes to change the rig");
  };
  require(now.sectionCount() == then.sectionCount(), "it has ", then.sectionCount(),
          " sections, expected ", now.sectionCount());
  for (int k = 0; k < now.sectionCount(); ++k) {
    require(namesOf(now, k) == namesOf(then, k), "section ", k + 1, " has the actuators ",
            namesOf(then, k), ", expected ", namesOf(now, k));
  }
  for (int i = 0; i < now.actuatorCount(); ++i) {
    require(now.actuator(i).drive == then.actuator(i).drive, now.actuator(i).name,
            " has another drive");
  }
  require(at_hand.isSeen() == next.isSeen() && at_hand.hasBodies() == next.hasBodies(),
          "only one of the two has `camera` and `tags`, or `bodies`");
  const auto bodiesOf = [](const Scene& scene) {
    std::string out;
    if (!scene.hasBodies()) return out;
    for (const estimation::TagPlacement& body : scene.tags->tags) out += " " + body.name;
    return out;
  };
  require(bodiesOf(at_hand) == bodiesOf(next), "its bodies are", bodiesOf(next), ", expected",
          bodiesOf(at_hand));
  require(at_hand.planar.has_value() == next.planar.has_value(), "its geometry is ",
          next.planar ? "planar" : "spatial", ", expected ", at_hand.planar ? "planar" : "spatial");
}

}  // namespace helix_arm::io
