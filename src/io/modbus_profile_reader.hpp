#pragma once

#include <optional>
#include <string>

#include "document.hpp"
#include "helix_arm/io/fault_list.hpp"
#include "helix_arm/regulator/modbus_profile.hpp"

namespace helix_arm::io {

/// Reads the profile of a device that speaks Modbus TCP: the map below `modbus_tcp`.
///
/// @param path  path of that map, for messages.
/// @param name  the profile's.
/// @return nothing, and at least one fault, if a rule is broken.
std::optional<regulator::ModbusProfile> readModbusProfile(const Value& value,
                                                          const std::string& path,
                                                          const std::string& name,
                                                          FaultList& faults);

}  // namespace helix_arm::io
