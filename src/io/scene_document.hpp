#pragma once

#include <string>
#include <vector>

#include "document.hpp"
#include "helix_arm/io/scene.hpp"

namespace helix_arm::io {

/// The tree of a scene file with its overrides; overrides that do not apply are among the faults.
/// @throws DocumentError where the file cannot be read or is not YAML.
Value readSceneDocument(const std::string& path, const std::vector<Override>& overrides,
                        FaultList& faults);

/// The scene that a tree describes.
/// @throws DocumentError with all faults.
Scene makeScene(const Value& document, FaultList& faults);

}  // namespace helix_arm::io
