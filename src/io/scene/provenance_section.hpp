#pragma once

#include <optional>

#include "helix_arm/io/provenance.hpp"
#include "io/document/map_reader.hpp"

namespace helix_arm::io {

/// Reads `calibration`; nothing if the scene has none.
std::optional<Provenance> readProvenance(const MapReader& scene, const Value& document,
                                         FaultList& faults);

/// The value of `calibration` for this provenance; reading it gives the same.
Value writeProvenance(const Provenance& provenance);

}  // namespace helix_arm::io
