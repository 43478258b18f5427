#pragma once

#include <string>

#include "document.hpp"
#include "helix_arm/estimation/contraction_fit.hpp"
#include "helix_arm/io/fault_list.hpp"
#include "helix_arm/io/scene.hpp"

namespace helix_arm::io {

/// Replaces a curve of a scene's document and resets the length scales of its actuators; its
/// response stays. Limits beyond the new curve are faults.
/// @throws std::invalid_argument if the fit has no curve, or the name is not that of a curve of
/// pressures.
void putContraction(const Scene& scene, const std::string& name,
                    const estimation::ContractionFit& fit, Value& document, FaultList& faults);

/// Replaces the response of a curve; one with neither lag nor play is removed.
/// @throws std::invalid_argument if the name is not that of a curve of pressures.
void putResponse(const Scene& scene, const std::string& name, const model::Response& response,
                 Value& document);

}  // namespace helix_arm::io
