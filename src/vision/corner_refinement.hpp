#pragma once

#include <opencv2/core.hpp>

#include "helix_arm/localization/tag_layout.hpp"
#include "helix_arm/vision/tag_family.hpp"

namespace helix_arm::vision {

/// Moves the corners of a tag to the intersections of the lines through its edges. An edge lies
/// where the gray level is half-way between the centres of the cells on its two sides; pixels
/// beyond these cells have no influence.
///
/// @param reach    maximum error of the given corners [px].
/// @param corners  [px]
/// @return the corners unchanged if the edges are farther away.
estimation::Corners refineCorners(const cv::Mat& gray, const TagFamily& family, double reach,
                                  const estimation::Corners& corners);

}  // namespace helix_arm::vision
