#pragma once

#include <functional>
#include <optional>
#include <string>
#include <vector>

#include <opencv2/core.hpp>
#include <ros/node_handle.h>
#include <ros/time.h>

#include "helix_arm/ArmShape.h"
#include "helix_arm/ModelError.h"
#include "helix_arm/TagDetections.h"
#include "helix_arm/vision/arm_localizer.hpp"
#include "ros_bridge/common/arm_frames.hpp"
#include "ros_bridge/common/model_history.hpp"
#include "vision_options.hpp"

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

// What is seen in a picture, as messages and as words.

/// All that is published of one picture, except frames and drawings.
struct ObservationReport {
  int tags = 0;  ///< of the arm in sight, each seen once
  /// What is seen: the summary where the shape is measured, else why it is not and what to check;
  /// and the ids of tags that no fit can use.
  std::string account;
  TagDetections detections;         ///< camera frame; in the order of Observation::detections
  std::optional<ArmShape> shape;    ///< base frame; only if measured
  std::optional<ModelError> error;  ///< measured shape less the model's; only if both are known
  std::string tip;                  ///< short text about the tip; empty unless measured
  std::vector<std::string> lines;   ///< for the overlay
};

/// `3, 4, 7`; the first few of many.
std::string listOf(const std::vector<int>& ids);

class VisionStatusPublisher;

/// Publishes what was measured in each picture: state, measured, model_error, tf, tag_detections,
/// and at a limited rate overlay and markers. With VisionOptions::publish_image also the picture
/// itself and its camera_info, while someone subscribes to them. For one thread.
/// @param frames  of the measured shape.
/// @param status  outlives the result.
/// @return to be called with each measurement.
std::function<void(const Measurement&)> measurementPublisher(ros::NodeHandle& node,
                                                             const VisionOptions& options,
                                                             const FrameNames& frames,
                                                             VisionStatusPublisher& status);

}  // namespace helix_arm::ros_bridge
