#pragma once

#include <map>
#include <optional>
#include <string>

#include "helix_arm/model/actuator.hpp"
#include "map_reader.hpp"

namespace helix_arm::io {

/// A curve that actuators refer to by name.
struct NamedContraction {
  model::Contraction curve;
  model::Drive drive;
  model::Response response{};  ///< between the pressure and the curve
};

/// All curves by name. A name whose declaration has faults maps to nothing: they are reported once,
/// not at every use.
using Contractions = std::map<std::string, std::optional<NamedContraction>>;

/// Reads `contractions`.
Contractions readContractions(const MapReader& scene, FaultList& faults);

}  // namespace helix_arm::io
