#pragma once

#include <cstddef>
#include <istream>
#include <optional>
#include <string>

#include "helix_arm/io/fault_list.hpp"

namespace helix_arm::io {

constexpr std::size_t kMostSceneBytes = 1U << 20U;   ///< of a scene or a profile
constexpr std::size_t kMostTableBytes = 64U << 20U;  ///< of a data set

/// The content of a regular text file; nothing, and a fault with the reason, if it cannot be read,
/// is not text or has more than `most` bytes.
std::optional<std::string> readTextFile(const std::string& path, std::size_t most,
                                        FaultList& faults);
/// The same of a stream, to its end.
std::optional<std::string> readTextStream(std::istream& in, std::size_t most, FaultList& faults);

}  // namespace helix_arm::io
