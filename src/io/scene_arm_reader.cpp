#include "scene_arm_reader.hpp"

#include <stdexcept>

#include "helix_arm/io/load_arm.hpp"
#include "load_reader.hpp"
#include "text_file.hpp"
#include "tier_reader.hpp"

namespace helix_arm::io {
namespace {

// Absent if the parts that it needs have faults.
std::optional<statics::ArmModel> readModel(const MapReader& scene, const Value& document,
                                           const ArmParts* arm, FaultList& faults) {
  const std::size_t faults_before = faults.count();
  std::optional<statics::Load> load = readLoad(scene, document, arm, faults);
  const statics::TierRequest request = readTierRequest(scene, document, arm, faults);
  if (arm == nullptr || faults.count() != faults_before) return std::nullopt;
  try {
    return statics::ArmModel(arm->arm, arm->planar, std::move(load), request);
  } catch (const std::invalid_argument& error) {
    // The message begins with the key.
    const std::string fault = error.what();
    const Value* key = document.find(fault.substr(0, fault.find_first_of(".:")));
    report(faults, (key == nullptr ? document : *key).place, fault);
    return std::nullopt;
  }
}

}  // namespace

const DocumentKind& sceneKind() {
  static const DocumentKind kind{
      {"name", "contractions", "arm", "load", "tier", "order", "accuracy", "budget", "tags",
       "camera", "vision", "simulation", "regulator", "safety", "follow", "calibration"},
      {"name", "contractions", "arm"},
      2};
  return kind;
}

std::string readSceneText(const std::string& path, FaultList& faults) {
  const std::optional<std::string> text = readTextFile(path, kMostSceneBytes, faults);
  faults.throwIfAny();
  return *text;
}

std::optional<Value> parseScene(const std::string& text, FaultList& faults) {
  return parseDocument(text, sceneKind(), faults);
}

Value parseScene(const std::string& text, const std::vector<Override>& overrides,
                 FaultList& faults) {
  std::optional<Value> document = parseScene(text, faults);
  if (!document) faults.throwIfAny();
  for (const Override& change : overrides) applyOverride(*document, change, faults);
  return std::move(*document);
}

SceneArmParts readSceneArm(const MapReader& scene, const Value& document, FaultList& faults) {
  SceneArmParts parts;
  parts.name = scene.word("name");
  parts.contractions = readContractions(scene, faults);
  parts.arm = readArm(scene, parts.contractions, faults);
  parts.model = readModel(scene, document, parts.arm ? &*parts.arm : nullptr, faults);
  return parts;
}

SceneArm loadArm(const std::string& path, const std::vector<Override>& overrides) {
  FaultList faults(path);
  const Value document = parseScene(readSceneText(path, faults), overrides, faults);
  SceneArmParts parts =
      readSceneArm(MapReader(document, "", sceneKind().keys, faults), document, faults);
  faults.throwIfAny();
  return {std::move(*parts.name), parts.arm->X_WB, std::move(*parts.model),
          std::move(parts.arm->looks)};
}

}  // namespace helix_arm::io
