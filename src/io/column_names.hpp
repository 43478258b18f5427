#pragma once

#include <string>
#include <vector>

namespace helix_arm::io {

/// How a message names a column of a table: by its name where that is one of ours (curvature_rad,
/// pressure_1_kpa, ..), by its number from 1 ("column 3") where it is not. The header of a file
/// that is no data set is no message.
std::string columnText(const std::vector<std::string>& columns, std::size_t index);

}  // namespace helix_arm::io
