#pragma once

#include <string>
#include <vector>

namespace helix_arm::io {

/// Name of a table's column in messages: its own if it is a known one (curvature_rad,
/// pressure_1_kpa, ..), otherwise its number from 1 ("column 3"), so that messages do not repeat
/// the content of files that are not data sets.
std::string columnText(const std::vector<std::string>& columns, std::size_t index);

}  // namespace helix_arm::io
