#pragma once

#include <vector>

#include "helix_arm/procedures/follow_run.hpp"

namespace helix_arm::procedures {

/// @param tips  number of tips that share the rows' time evenly; 0 for a path.
FollowFigures figuresOf(const std::vector<FollowRow>& rows, int tips);

}  // namespace helix_arm::procedures
