#pragma once

#include <opencv2/core.hpp>

#include "ros_bridge/vision/measurement.hpp"
#include "ros_bridge/vision/observations.hpp"

namespace helix_arm::ros_bridge {

/// Draws over a picture what was seen in it.
///
/// Tags are outlined, with their ids: green, red where they do not fit, grey where they are not the
/// arm's or seen twice. The measured curve is solid, the model's dashed. The report's lines of text
/// are in the upper left corner.
/// @return (CV_8UC3), BGR.
cv::Mat drawOverlay(const Measurement& measurement, const ObservationReport& report);

}  // namespace helix_arm::ros_bridge
