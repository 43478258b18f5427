#pragma once

#include <string>

#include "helix_arm/io/scene.hpp"
#include "map_reader.hpp"

namespace helix_arm::io {

/// Reads `vision`; defaults where the scene says nothing.
/// @param family  of the tags; empty where the scene has none.
vision::LocalizerConfig readVision(const MapReader& scene, const Value& document,
                                   const std::string& family, FaultList& faults);

}  // namespace helix_arm::io
