#pragma once

#include "arm_reader.hpp"
#include "helix_arm/statics/tier.hpp"
#include "map_reader.hpp"

namespace helix_arm::io {

/// Reads `tier`, `order`, `accuracy` and `budget`, which say how shapes are computed.
/// @param arm  null where the faults leave no arm, so that none says what it allows.
statics::TierRequest readTierRequest(const MapReader& scene, const Value& document,
                                     const ArmParts* arm, FaultList& faults);

}  // namespace helix_arm::io
