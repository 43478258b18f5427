#pragma once

#include <optional>
#include <string>
#include <vector>

#include "helix_arm/ArmShape.h"
#include "helix_arm/ModelError.h"
#include "helix_arm/TagDetections.h"
#include "ros_bridge/vision/measurement.hpp"

/// What is seen in a picture, as messages and as words.
namespace helix_arm::ros_bridge {

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

/// @param base_frame    of the arm.
/// @param camera_frame  of the picture.
ObservationReport reportOf(const Measurement& measurement, const std::string& base_frame,
                           const std::string& camera_frame);

/// `3, 4, 7`; the first few of many.
std::string listOf(const std::vector<int>& ids);

}  // namespace helix_arm::ros_bridge
