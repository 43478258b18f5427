#pragma once

#include <optional>

#include "helix_arm/io/scene.hpp"
#include "map_reader.hpp"

namespace helix_arm::io {

/// The optical frame C (z forward, x right, y down) seen from the camera's body (x forward, y left,
/// z up).
extern const Eigen::Matrix3d kOpticalInBody;

/// Reads `camera`; nothing if the scene has none.
std::optional<CameraConfig> readCamera(const MapReader& scene, const Value& document,
                                       FaultList& faults);

}  // namespace helix_arm::io
