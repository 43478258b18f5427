#pragma once

#include <optional>

#include "helix_arm/io/scene.hpp"
#include "map_reader.hpp"

namespace helix_arm::io {

/// Reads `follow`; defaults for what the scene omits.
/// @param safety     tells the regulator's lag.
/// @param regulator  absent if there is none, or if it has faults.
follow::VisualServoConfig readFollow(const MapReader& scene, const Value& document,
                                     const SafetyConfig& safety,
                                     const std::optional<regulator::Config>& regulator,
                                     FaultList& faults);

}  // namespace helix_arm::io
