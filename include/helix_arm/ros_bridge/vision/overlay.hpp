#pragma once

#include <string>
#include <vector>

#include <opencv2/core.hpp>

#include "helix_arm/vision/arm_localizer.hpp"

namespace helix_arm::ros_bridge {

/// Draws over a picture what was seen in it.
///
/// Tags are outlined, with their ids: green, red where they do not fit, grey where they are not the
/// arm's or seen twice. The measured curve is solid, the model's dashed.
/// @param gray   (CV_8UC1).
/// @param model  null: none is drawn.
/// @param lines  of text, in the upper left corner.
/// @return (CV_8UC3), BGR.
cv::Mat drawOverlay(const cv::Mat& gray, const estimation::ArmView& view,
                    const vision::Sight& sight, const model::Shape* model,
                    const std::vector<std::string>& lines);

}  // namespace helix_arm::ros_bridge
