#include <algorithm>
#include <filesystem>

#include "helix_arm/io/atomic_file.hpp"
#include "helix_arm/io/scene.hpp"
#include "helix_arm/statics/loaded.hpp"
#include "io/document/document.hpp"
#include "io/document/map_reader.hpp"
#include "profile_file.hpp"
#include "provenance_section.hpp"
#include "regulator_reader.hpp"
#include "scene_document.hpp"
#include "vision_reader.hpp"

namespace helix_arm::io {

SceneDocument readSceneDocument(const std::string& path, const std::vector<Override>& overrides,
                                FaultList& faults) {
  const std::string text = readSceneText(path, faults);
  Value document = parseScene(text, overrides, faults);
  if (Value* profile = relativeProfile(document)) {
    profile->text = std::filesystem::absolute(path).parent_path() / profile->text;
  }
  return {std::move(document), sha256Of(text)};
}

std::string sceneText(const std::string& path, const std::vector<Override>& overrides) {
  FaultList faults(path);
  if (overrides.empty()) {
    std::string text = readSceneText(path, faults);
    std::optional<Value> plain = parseScene(text, faults);
    faults.throwIfAny();
    if (relativeProfile(*plain) == nullptr) return text;
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
  const std::optional<Value> document = parseScene(text, faults);
  faults.throwIfAny();
  return makeScene(*document, faults);
}

Scene makeScene(const Value& document, FaultList& faults) {
  const MapReader scene(document, "", sceneKind().keys, faults);
  auto [name, contractions, arm, model] = readSceneArm(scene, document, faults);
  const ArmParts* const known_arm = arm ? &*arm : nullptr;
  std::optional<TagParts> tags = readTags(scene, document, known_arm, faults);
  const auto camera = readCamera(scene, document, faults);
  vision::LocalizerConfig vision =
      readVision(scene, document, tags ? tags->family : std::string(), faults);
  const bool pulled_out = model && model->load() && !statics::inPlane(*model->load());
  vision.fit.planar = known_arm != nullptr && known_arm->planar.has_value() && !pulled_out;
  const SimulationConfig simulation = readSimulation(scene, document, known_arm, faults);
  const auto regulator = readRegulator(scene, document, known_arm, faults);
  const SafetyConfig safety = readSafety(scene, document, known_arm, regulator, faults);
  const follow::VisualServoConfig follow = readFollow(scene, document, safety, regulator, faults);
  std::optional<Provenance> calibration = readProvenance(scene, document, faults);
  faults.throwIfAny();
  const lie::SE3 X_BF = tags ? tags->X_BF : lie::SE3();
  const estimation::TagPrior tag_prior = tags ? tags->prior : estimation::TagPrior();
  std::map<std::string, model::Response> curves;
  for (const auto& [curve, contraction] : contractions) curves[curve] = contraction->response;
  return {*name,
          std::move(curves),
          arm->X_WB,
          std::move(arm->arm),
          std::move(arm->planar),
          std::move(*model),
          std::move(arm->looks),
          regulator,
          tags ? std::optional(std::move(tags->layout)) : std::nullopt,
          tag_prior,
          X_BF,
          camera,
          vision,
          simulation,
          safety,
          follow,
          std::move(calibration),
          {}};
}

}  // namespace helix_arm::io
