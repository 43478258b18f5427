#pragma once

#include <optional>

#include "helix_arm/estimation/placed_view.hpp"
#include "helix_arm/io/scene.hpp"

namespace helix_arm::procedures {

/// The scene's view of its arm, with the standard errors of its calibration where that fitted
/// placements, and its priors of them otherwise; a base that is fitted counts as learnt from the
/// pictures. Nothing without a camera or tags.
std::optional<estimation::PlacedView> placedViewOf(const io::Scene& scene);

}  // namespace helix_arm::procedures
