#pragma once

#include <optional>

#include "arm_reader.hpp"
#include "helix_arm/io/scene.hpp"
#include "helix_arm/regulator/config.hpp"
#include "io/document/map_reader.hpp"

namespace helix_arm::io {

/// Reads `regulator` and the profile that it names; nothing if the scene has none, or it has a
/// fault.
/// @param arm  the scene's arm; null if it has faults.
std::optional<regulator::Config> readRegulator(const MapReader& scene, const Value& document,
                                               const ArmParts* arm, FaultList& faults);

/// Reads `safety`; defaults for what the scene omits.
/// @param arm        null if it has faults: then there are no channels.
/// @param regulator  absent if there is none, or if it has faults.
SafetyConfig readSafety(const MapReader& scene, const Value& document, const ArmParts* arm,
                        const std::optional<regulator::Config>& regulator, FaultList& faults);

}  // namespace helix_arm::io
