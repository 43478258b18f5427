#pragma once

#include <optional>
#include <string>
#include <vector>

#include "document.hpp"
#include "helix_arm/io/fault_list.hpp"
#include "helix_arm/regulator/modbus_profile.hpp"
#include "helix_arm/regulator/serial_profile.hpp"
#include "map_reader.hpp"

namespace helix_arm::io {

/// Names of the profiles of regulators that are shipped, in alphabetical order.
std::vector<std::string> shippedProfiles();

/// The profile that a scene names by a path of its own, relative to the scene's folder; null where
/// it names none so. Such a path (it has a '/' or ends in .yaml) is no more good once the scene is
/// elsewhere.
Value* relativeProfile(Value& scene);

/// The profile that the key `profile` of a kind of regulator names: shipped, or a path. What its
/// file breaks are faults of that file and its lines.
/// @return nothing, and at least one fault, where there is no such profile.
std::optional<regulator::SerialProfile> readSerialProfileFile(const MapReader& keys,
                                                              FaultList& faults);
/// The same of "modbus_tcp".
std::optional<regulator::ModbusProfile> readModbusProfileFile(const MapReader& keys,
                                                              FaultList& faults);

}  // namespace helix_arm::io
