#pragma once

#include <optional>

#include <opencv2/core.hpp>

#include "closed_border.hpp"
#include "helix_arm/vision/tag_detector.hpp"

namespace helix_arm::vision {

/// Finds one tag by the edges of its border, and makes sure of it: the border is black all around,
/// the bits are the tag's, and the edges between its cells lie where the corners put them.
///
/// A tag whose middle is up to a quarter of its shorter side off, but no more than 12 px, is
/// caught; 0.2 rad of turn and a tenth in size do not matter.
///
/// @param gray      (CV_8UC1)
/// @param family    with a closed border.
/// @param expected  [px]; whatever it is, nothing worse than not finding the tag comes of it.
std::optional<TagDetection> lockOnEdges(const cv::Mat& gray, const TagFamily& family, int id,
                                        const TagPattern& pattern,
                                        const estimation::Corners& expected, int max_hamming);

/// False where the edges between the cells of a tag show that its corners are elsewhere, as
/// happens where something lies along one of its sides.
///
/// @param gray     (CV_8UC1)
/// @param corners  [px]
bool cornersHold(const cv::Mat& gray, const TagPattern& pattern,
                 const estimation::Corners& corners);

}  // namespace helix_arm::vision
