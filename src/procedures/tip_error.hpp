#pragma once

#include <optional>
#include <vector>

#include "helix_arm/estimation/calibration.hpp"
#include "helix_arm/io/scene.hpp"

/// How far a scene's model is from the tags, in units that a user of the arm knows.
namespace helix_arm::procedures {

/// Median distance of the model's tip from that of the shape fitted to each capture's tags by
/// itself [m], as in model_error. Captures whose tags determine no shape, or for which the model
/// has none, are left out.
/// @return nothing if no capture is left, as for curvatures.
std::optional<double> medianTipError(const io::Scene& scene,
                                     const std::vector<estimation::Capture>& captures);

}  // namespace helix_arm::procedures
