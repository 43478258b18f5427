#pragma once

#include "helix_arm/io/scene.hpp"
#include "map_reader.hpp"

namespace helix_arm::io {

/// Reads `simulation`; defaults for what the scene omits.
SimulationConfig readSimulation(const MapReader& scene, const Value& document, FaultList& faults);

}  // namespace helix_arm::io
