#pragma once

#include <optional>
#include <string>

#include "document.hpp"
#include "helix_arm/io/fault_list.hpp"
#include "helix_arm/regulator/serial_profile.hpp"

namespace helix_arm::io {

/// Reads the profile of a device on a serial line: the map below `ascii_serial`.
///
/// @param path  path of that map, for messages.
/// @param name  the profile's.
/// @return nothing, and at least one fault, if a rule is broken.
std::optional<regulator::SerialProfile> readSerialProfile(const Value& value,
                                                          const std::string& path,
                                                          const std::string& name,
                                                          FaultList& faults);

}  // namespace helix_arm::io
