#pragma once

#include <Eigen/Core>
#include <vector>

#include "nlohmann/json.hpp"

namespace helix_arm::cli {

/// A tip and, where it was asked for, its sensitivity.
struct CloudPoint {
  Eigen::Vector3d tip;          ///< base frame [m]
  Eigen::Vector3d sensitivity;  ///< [m]
};

/// What plot_report draws of points: their number and, with sensitivity, the medians of it, over
/// square cells of the planes x-z, y-z and x-y; planes that they have no width in are left out.
///
/// One entry a map: {quantity, title, unit, across, up, extent [left, right, bottom, top] in m,
/// cells (rows from the bottom; null where there is no point)}.
nlohmann::json mapsJson(const std::vector<CloudPoint>& points, bool sensitivity);

}  // namespace helix_arm::cli
