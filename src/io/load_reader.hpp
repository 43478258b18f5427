#pragma once

#include <optional>

#include "arm_reader.hpp"
#include "helix_arm/statics/load.hpp"
#include "map_reader.hpp"

namespace helix_arm::io {

/// Reads `load`; values given in the world frame are rotated into the arm's base. If the scene has
/// none but the arm has K_eps, a load that is empty except for K_eps. Nothing if it has neither, or
/// faults leave none.
/// @param arm  null if faults leave no arm; the faults of `load` itself are still found.
std::optional<statics::Load> readLoad(const MapReader& scene, const Value& document,
                                      const ArmParts* arm, FaultList& faults);

}  // namespace helix_arm::io
