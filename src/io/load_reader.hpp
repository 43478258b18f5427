#pragma once

#include <optional>

#include "arm_reader.hpp"
#include "helix_arm/statics/load.hpp"
#include "map_reader.hpp"

namespace helix_arm::io {

/// Reads `load`, what it gives as the world sees it turned into the arm's base; nothing where the
/// scene has none, or its faults leave none.
/// @param arm  null where the faults leave no arm; the faults of `load` itself are still found.
std::optional<statics::Load> readLoad(const MapReader& scene, const Value& document,
                                      const ArmParts* arm, FaultList& faults);

}  // namespace helix_arm::io
