#pragma once

#include <cstddef>
#include <string>

namespace helix_arm::basics {

/// Text of foreign make as messages show it: what is not printable ASCII becomes '?', and what is
/// longer than `most` characters is cut and ends in "...".
std::string quoted(const std::string& text, std::size_t most = 64);

}  // namespace helix_arm::basics
