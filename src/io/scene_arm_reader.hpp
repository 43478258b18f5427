#pragma once

#include <optional>
#include <string>
#include <vector>

#include "arm_reader.hpp"
#include "contraction_reader.hpp"
#include "document.hpp"
#include "helix_arm/io/override.hpp"
#include "helix_arm/statics/arm_model.hpp"
#include "map_reader.hpp"

namespace helix_arm::io {

/// How scenes are recognised.
const DocumentKind& sceneKind();

/// The text of a scene file. @throws DocumentError if it cannot be read.
std::string readSceneText(const std::string& path, FaultList& faults);

/// The tree of a scene's text; nothing, and a fault that does not repeat its content, if it is not
/// a scene.
std::optional<Value> parseScene(const std::string& text, FaultList& faults);

/// The same with overrides; overrides that do not apply are faults.
/// @throws DocumentError if the text is not YAML or not a scene.
Value parseScene(const std::string& text, const std::vector<Override>& overrides,
                 FaultList& faults);

/// The arm of a scene.
struct SceneArmParts {
  std::optional<std::string> name;
  Contractions contractions;
  std::optional<ArmParts> arm;
  std::optional<statics::ArmModel> model;
};

/// Reads the keys that loadArm() names. Each part is absent if faults concern it.
SceneArmParts readSceneArm(const MapReader& scene, const Value& document, FaultList& faults);

}  // namespace helix_arm::io
