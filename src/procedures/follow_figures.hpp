#pragma once

#include <vector>

#include "helix_arm/procedures/follow_run.hpp"

namespace helix_arm::procedures {

/// @param tips  number of tips that share the rows' time evenly.
FollowFigures tipFigures(const std::vector<FollowRow>& rows, int tips);
/// @param duration  of the path [s].
FollowFigures pathFigures(const std::vector<FollowRow>& rows, double duration);

}  // namespace helix_arm::procedures
