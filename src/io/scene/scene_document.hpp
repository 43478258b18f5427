#pragma once

#include <string>
#include <vector>

#include "arm_reader.hpp"
#include "helix_arm/io/scene.hpp"
#include "io/document/document.hpp"

namespace helix_arm::io {

/// The tree of a scene file with its overrides, and the hash of the bytes read.
struct SceneDocument {
  Value document;
  std::string sha256;
};

/// Reads a scene file; overrides that do not apply are faults.
/// @throws DocumentError if the file cannot be read, is not YAML or not a scene.
SceneDocument readSceneDocument(const std::string& path, const std::vector<Override>& overrides,
                                FaultList& faults);

/// The scene that a tree describes.
/// @throws DocumentError with all faults.
Scene makeScene(const Value& document, FaultList& faults);

}  // namespace helix_arm::io
