#pragma once

#include "arm_reader.hpp"
#include "helix_arm/io/scene.hpp"
#include "map_reader.hpp"

namespace helix_arm::io {

/// Reads `simulation`; defaults for what the scene omits.
/// @param arm  null if the arm has faults.
SimulationConfig readSimulation(const MapReader& scene, const Value& document, const ArmParts* arm,
                                FaultList& faults);

}  // namespace helix_arm::io
