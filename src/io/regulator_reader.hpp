#pragma once

#include <optional>

#include "arm_reader.hpp"
#include "helix_arm/regulator/config.hpp"
#include "map_reader.hpp"

namespace helix_arm::io {

/// Reads `regulator` and the profile that it names; nothing if the scene has none, or it has a
/// fault.
/// @param arm  the scene's arm; null if it has faults.
std::optional<regulator::Config> readRegulator(const MapReader& scene, const Value& document,
                                               const ArmParts* arm, FaultList& faults);

}  // namespace helix_arm::io
