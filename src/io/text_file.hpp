#pragma once

#include <optional>
#include <string>

#include "helix_arm/io/fault_list.hpp"

namespace helix_arm::io {

/// The whole of a file; nothing, and a fault with the system's reason, where it cannot be read.
std::optional<std::string> readTextFile(const std::string& path, FaultList& faults);

}  // namespace helix_arm::io
