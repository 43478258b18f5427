#pragma once

#include <cstddef>
#include <string>

namespace helix_arm::basics {

/// Untrusted text for messages: characters other than printable ASCII become '?', and text longer
/// than `most` characters is truncated and ends in "...".
std::string quoted(const std::string& text, std::size_t most = 64);

}  // namespace helix_arm::basics
