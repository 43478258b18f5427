#pragma once

#include <string>
#include <vector>

#include "helix_arm/control/tip_path.hpp"
#include "helix_arm/io/data_set.hpp"

namespace helix_arm::io {

/// The way points of a data set with columns time_s, x_m, y_m and z_m, seen from the arm's base.
/// Other columns are not read. control::TipPath accepts what this returns.
/// @throws DocumentError with all faults: a missing column, fewer than control::kFewestWayPoints or
/// more than control::kMostWayPoints rows, a time outside 0 to control::kLongestPath or less than
/// control::kShortestStep after that of the row before, a position beyond statics::kFarthestTarget.
std::vector<control::TipWayPoint> loadTipPath(const DataSet& data);

/// The text of such a data set; loading it gives the same numbers. Rotations and velocities are not
/// written.
/// @param comment  initial comment lines, empty for none.
std::string tipPathCsv(const std::vector<control::TipWayPoint>& points, const std::string& comment);

}  // namespace helix_arm::io
