#pragma once

#include <opencv2/core.hpp>

#include "helix_arm/estimation/tag_layout.hpp"
#include "helix_arm/vision/tag_family.hpp"

namespace helix_arm::vision {

/// Moves the corners of a tag to where the lines through its edges cross. An edge runs where the
/// gray level is half-way between those in the middle of the cells on its two sides; what lies
/// beyond these cells does not matter.
///
/// @param reach    how far off the corners may be [px].
/// @param corners  [px]
/// @return the corners as they were where the edges lead farther away.
estimation::Corners refineCorners(const cv::Mat& gray, const TagFamily& family, double reach,
                                  const estimation::Corners& corners);

}  // namespace helix_arm::vision
