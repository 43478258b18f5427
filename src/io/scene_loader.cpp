#include <algorithm>
#include <filesystem>
#include <stdexcept>

#include "arm_reader.hpp"
#include "camera_reader.hpp"
#include "contraction_reader.hpp"
#include "document.hpp"
#include "helix_arm/io/content_hash.hpp"
#include "helix_arm/io/scene.hpp"
#include "helix_arm/statics/loaded.hpp"
#include "load_reader.hpp"
#include "map_reader.hpp"
#include "profile_file.hpp"
#include "provenance_section.hpp"
#include "regulator_reader.hpp"
#include "safety_reader.hpp"
#include "scene_document.hpp"
#include "simulation_reader.hpp"
#include "tag_reader.hpp"
#include "text_file.hpp"
#include "tier_reader.hpp"
#include "vision_reader.hpp"

namespace helix_arm::io {
namespace {

// Nothing where there are faults that concern it.
std::optional<statics::ArmModel> readModel(const MapReader& scene, const Value& document,
                                           const ArmParts* arm, FaultList& faults) {
  const std::size_t faults_before = faults.count();
  std::optional<statics::Load> load = readLoad(scene, document, arm, faults);
  const statics::TierRequest request = readTierRequest(scene, document, arm, faults);
  if (arm == nullptr || faults.count() != faults_before) return std::nullopt;
  try {
    return statics::ArmModel(arm->arm, arm->planar, std::move(load), request);
  } catch (const std::invalid_argument& error) {
    // It begins with its key.
    const std::string fault = error.what();
    const Value* key = document.find(fault.substr(0, fault.find_first_of(".:")));
    report(faults, (key == nullptr ? document : *key).place, fault);
    return std::nullopt;
  }
}

const DocumentKind& sceneKind() {
  static const DocumentKind kind{
      {"name", "contractions", "arm", "load", "tier", "order", "accuracy", "budget", "tags",
       "camera", "vision", "simulation", "regulator", "safety", "calibration"},
      {"name", "contractions", "arm"},
      2};
  return kind;
}

std::string readText(const std::string& path, FaultList& faults) {
  const std::optional<std::string> text = readTextFile(path, kMostSceneBytes, faults);
  faults.throwIfAny();
  return *text;
}

}  // namespace

std::optional<Value> parseScene(const std::string& text, FaultList& faults) {
  return parseDocument(text, sceneKind(), faults);
}

SceneDocument readSceneDocument(const std::string& path, const std::vector<Override>& overrides,
                                FaultList& faults) {
  const std::string text = readText(path, faults);
  std::optional<Value> document = parseScene(text, faults);
  if (!document) faults.throwIfAny();
  for (const Override& change : overrides) applyOverride(*document, change, faults);
  if (Value* profile = relativeProfile(*document)) {
    profile->text = std::filesystem::absolute(path).parent_path() / profile->text;
  }
  return {std::move(*document), sha256Of(text)};
}

std::string sceneText(const std::string& path, const std::vector<Override>& overrides) {
  FaultList faults(path);
  if (overrides.empty()) {
    std::string text = readText(path, faults);
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
  const SectionLook& widest = *std::max_element(
      looks.begin(), looks.end(),
      [](const auto& a, const auto& b) { return a.separator_radius < b.separator_radius; });
  return simulation::CameraSetup{simulation::deviate(view(), arm, simulation.mounts),
                                 vision::TagFamily(vision.detector.family),
                                 {widest.separator_radius},
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
  const auto name = scene.word("name");
  const Contractions contractions = readContractions(scene, faults);
  std::optional<ArmParts> arm = readArm(scene, contractions, faults);
  const ArmParts* const known_arm = arm ? &*arm : nullptr;
  std::optional<statics::ArmModel> model = readModel(scene, document, known_arm, faults);
  std::optional<TagParts> tags = readTags(scene, document, known_arm, faults);
  const auto camera = readCamera(scene, document, faults);
  vision::LocalizerConfig vision =
      readVision(scene, document, tags ? tags->family : std::string(), faults);
  const bool pulled_out = model && model->load() && !statics::inPlane(*model->load());
  vision.fit.planar = known_arm != nullptr && known_arm->planar.has_value() && !pulled_out;
  const SimulationConfig simulation = readSimulation(scene, document, faults);
  const auto regulator = readRegulator(scene, document, known_arm, faults);
  const SafetyConfig safety = readSafety(scene, document, known_arm, regulator, faults);
  std::optional<Provenance> calibration = readProvenance(scene, document, faults);
  faults.throwIfAny();
  const lie::SE3 X_BF = tags ? tags->X_BF : lie::SE3();
  const estimation::TagPrior tag_prior = tags ? tags->prior : estimation::TagPrior();
  std::vector<std::string> curves;
  for (const auto& [curve, contraction] : contractions) curves.push_back(curve);
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
          std::move(calibration),
          {}};
}

}  // namespace helix_arm::io
