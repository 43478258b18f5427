#pragma once

#include <optional>

#include "helix_arm/io/scene.hpp"
#include "map_reader.hpp"

namespace helix_arm::io {

/// Reads `camera`; nothing where the scene has none.
std::optional<CameraConfig> readCamera(const MapReader& scene, const Value& document,
                                       FaultList& faults);

}  // namespace helix_arm::io
