#pragma once

#include <string>
#include <vector>

#include "helix_arm/io/scene.hpp"
#include "helix_arm/procedures/calibration_job.hpp"
#include "helix_arm/procedures/sample.hpp"

namespace helix_arm::ros_bridge {

/// The samples that were recorded of an arm, and its scene.
struct Recording {
  io::Scene scene;
  std::vector<procedures::Sample> samples;

  /// What a calibration takes.
  /// @throws std::invalid_argument without samples, io::DocumentError as
  /// procedures::makeCaptures().
  procedures::CalibrationData data() const;
  /// A data set of tag corners, as CSV.
  std::string table() const;
};

}  // namespace helix_arm::ros_bridge
