#pragma once

#include <cstddef>
#include <string>
#include <vector>

#include "helix_arm/io/scene.hpp"
#include "helix_arm/procedures/calibration_job.hpp"
#include "helix_arm/procedures/response_series.hpp"
#include "helix_arm/procedures/sample.hpp"

namespace helix_arm::ros_bridge {

/// The samples that were recorded of an arm, and its scene.
struct Recording {
  io::Scene scene;
  std::vector<procedures::Sample> samples;
  procedures::ResponseSeries series;  ///< of a run in a loop; empty without one
  std::size_t left_out = 0;           ///< rows that the series has no room for

  /// What a calibration takes.
  /// @throws std::invalid_argument without samples, io::DocumentError as
  /// procedures::makeCaptures().
  procedures::CalibrationData data() const;
  /// A data set of tag corners, as CSV.
  std::string table() const;
  /// A data set of the series, as CSV; its times are those of the table.
  std::string seriesTable() const;
};

}  // namespace helix_arm::ros_bridge
