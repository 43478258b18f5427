#pragma once

#include <optional>
#include <string>

#include <opencv2/core.hpp>
#include <ros/time.h>

#include "helix_arm/vision/arm_localizer.hpp"
#include "ros_bridge/common/model_history.hpp"

namespace helix_arm::ros_bridge {

/// What was seen in one picture, and what it is compared with. It refers to memory of the picture
/// and of the PictureMeasurer: it is valid until the next picture is measured, and no longer than
/// its picture.
struct Measurement {
  ros::Time stamp;  ///< of the picture
  cv::Mat gray;     ///< (CV_8UC1)
  const vision::Observation& observation;
  const estimation::ArmView& view;           ///< camera and tags that it was measured with
  const vision::LocalizerConfig& config;     ///< that it was measured with
  std::optional<ModelHistory::Entry> model;  ///< of the picture's time
  std::string calibration;                   ///< whose intrinsics were used

  bool measured() const { return observation.state == vision::ObservationState::kMeasured; }
  /// Null where there is no model of the picture's time.
  const model::Shape* modelShape() const { return model ? &model->shape : nullptr; }
};

}  // namespace helix_arm::ros_bridge
