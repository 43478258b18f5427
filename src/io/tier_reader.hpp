#pragma once

#include "arm_reader.hpp"
#include "helix_arm/statics/tier.hpp"
#include "map_reader.hpp"

namespace helix_arm::io {

/// Reads `tier`, `order`, `accuracy` and `budget`, which choose how shapes are computed.
/// @param arm  null if faults leave no arm; then the request is not checked against it.
statics::TierRequest readTierRequest(const MapReader& scene, const Value& document,
                                     const ArmParts* arm, FaultList& faults);

}  // namespace helix_arm::io
