#pragma once

#include <string>

#include "helix_arm/io/scene.hpp"
#include "map_reader.hpp"

namespace helix_arm::io {

/// Reads `vision`; defaults for what the scene omits.
/// @param family  family of the tags; empty if the scene has none.
vision::LocalizerConfig readVision(const MapReader& scene, const Value& document,
                                   const std::string& family, FaultList& faults);

}  // namespace helix_arm::io
