#pragma once

#include <optional>

#include "arm_reader.hpp"
#include "helix_arm/regulator/config.hpp"
#include "map_reader.hpp"

namespace helix_arm::io {

/// Reads `regulator` and the profile that it names; nothing where the scene has none, or a fault.
/// @param arm  what is known of the scene's arm; null where it has faults.
std::optional<regulator::Config> readRegulator(const MapReader& scene, const Value& document,
                                               const ArmParts* arm, FaultList& faults);

}  // namespace helix_arm::io
