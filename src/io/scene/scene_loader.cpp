#include <algorithm>
#include <filesystem>

#include "helix_arm/basics/requirement.hpp"
#include "helix_arm/io/atomic_file.hpp"
#include "helix_arm/io/scene.hpp"
#include "helix_arm/simulation/rig.hpp"
#include "helix_arm/statics/loaded.hpp"
#include "scene_readers.hpp"

namespace helix_arm::io {

namespace {

// Files that the scene names relative to its folder.
std::vector<Value*> relativePaths(Value& document) {
  std::vector<Value*> out = relativeMeshes(document);
  if (Value* profile = relativeProfile(document)) out.push_back(profile);
  return out;
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
  if (!camera || !tags) return std::nullopt;
  std::vector<double> radii;
  for (const SectionLook& look : looks) radii.push_back(look.separator_radius);
  return simulation::CameraSetup{simulation::deviate(view(), arm, simulation.mounts),
                                 vision::TagFamily(vision.detector.family),
                                 {std::move(radii)},
                                 simulation.camera};
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

namespace {

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

}  // namespace

dynamics::MotionConfig readDynamics(const MapReader& scene) {
  constexpr NumberRule kDamping = within(kNotNegative, 0, 1e3, " s");
  dynamics::MotionConfig config;
  dynamics::StrainTimes& damping = config.damping;
  scene.map("dynamics",
            {{"damping_s",
              {Key("stretch", kDamping, damping.stretch), Key("shear", kDamping, damping.shear),
               Key("twist", kDamping, damping.twist), Key("bend", kDamping, damping.bend)}},
             Key("inertia_radius_m", kLength, config.inertia_radius),
             Key("order", Whole{0, dynamics::kMostOrder}, config.order),
             Key("step_s", within(kPositive, 1e-6, 0.1, " s"), config.step)});
  return config;
}

Scene makeScene(const Value& document, FaultList& faults) {
  const MapReader keys(document, "", keysOf(sceneKind().keys), faults);
  auto [name, contractions, arm, model] = readSceneArm(keys);
  const ArmParts* const known_arm = arm ? &*arm : nullptr;
  std::optional<TagParts> tags = readTags(keys, known_arm);
  const MotionCapture motion_capture = readMotionCapture(keys);
  auto camera = readCamera(keys);
  vision::LocalizerConfig vision = readVision(keys, tags ? tags->family : std::string());
  SimulationConfig simulation = readSimulation(keys, known_arm);
  auto regulator = readRegulator(keys, known_arm);
  SafetyConfig safety = readSafety(keys, known_arm, regulator);
  std::optional<clearance::KeepOut> keep_out = readKeepOut(keys, known_arm);
  const dynamics::MotionConfig dynamics = readDynamics(keys);
  const follow::VisualServoConfig follow = readFollow(keys, safety, regulator);
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
  require(at_hand.camera.has_value() == next.camera.has_value() &&
              at_hand.tags.has_value() == next.tags.has_value(),
          "only one of the two has `camera` and `tags`");
  require(at_hand.planar.has_value() == next.planar.has_value(), "its geometry is ",
          next.planar ? "planar" : "spatial", ", expected ", at_hand.planar ? "planar" : "spatial");
}

}  // namespace helix_arm::io
