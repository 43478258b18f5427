#pragma once

#include <optional>

#include <opencv2/core.hpp>

#include "closed_border.hpp"
#include "helix_arm/vision/tag_detector.hpp"

namespace helix_arm::vision {

/// Finds one tag by the edges of its border and verifies it: the border is black all around, the
/// bits are the tag's, and the edges between its cells agree with the corners.
///
/// A tag is found if its centre is off by at most a quarter of its shorter side and at most 12 px.
/// Errors of 0.2 rad in rotation and 10 % in size are tolerated.
///
/// @param gray      (CV_8UC1)
/// @param family    with a closed border.
/// @param expected  [px]; any values; at worst the tag is not found.
std::optional<TagDetection> lockOnEdges(const cv::Mat& gray, const TagFamily& family, int id,
                                        const TagPattern& pattern,
                                        const estimation::Corners& expected, int max_hamming);

/// False if the edges between the cells of a tag contradict its corners, for example because
/// something lies along one of its sides.
///
/// @param gray     (CV_8UC1)
/// @param corners  [px]
bool cornersHold(const cv::Mat& gray, const TagPattern& pattern,
                 const estimation::Corners& corners);

}  // namespace helix_arm::vision
