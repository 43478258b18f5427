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

/// What tells a scene from any other document.
const DocumentKind& sceneKind();

/// The text of a scene file. @throws DocumentError where it cannot be read.
std::string readSceneText(const std::string& path, FaultList& faults);

/// The tree of a scene's text as it is; nothing, and a fault that holds nothing of it, where it is
/// of something else.
std::optional<Value> parseScene(const std::string& text, FaultList& faults);

/// The same with overrides; those that do not apply are among the faults.
/// @throws DocumentError where the text is not YAML or not a scene.
Value parseScene(const std::string& text, const std::vector<Override>& overrides,
                 FaultList& faults);

/// What a scene says of its arm.
struct SceneArmParts {
  std::optional<std::string> name;
  Contractions contractions;
  std::optional<ArmParts> arm;
  std::optional<statics::ArmModel> model;
};

/// Reads the keys that loadArm() names. Each part is absent where there are faults that concern it.
SceneArmParts readSceneArm(const MapReader& scene, const Value& document, FaultList& faults);

}  // namespace helix_arm::io
