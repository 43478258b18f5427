#pragma once

#include <optional>
#include <vector>

#include "helix_arm/estimation/tag_layout.hpp"
#include "helix_arm/estimation/twist_fit.hpp"
#include "helix_arm/model/shape.hpp"

namespace helix_arm::vision {

/// Approximate pose X_CB of the base seen from the camera, without an initial guess.
///
/// Every tag alone gives two poses; the one with the least median error over all tags is returned.
/// So fewer than half of the tags may be misplaced.
/// @param seen   one entry per tag, indices of the layout.
/// @param focal  converts errors of directions to pixels, > 0 [px].
/// @return nothing if no pose has most tags before the camera.
std::optional<lie::SE3> startOfPlacement(const estimation::TagLayout& layout,
                                         const model::Shape& shape,
                                         const std::vector<estimation::CornerObservation>& seen,
                                         double focal);

}  // namespace helix_arm::vision
