#pragma once

#include <string>
#include <variant>
#include <vector>

#include "helix_arm/regulator/line_format.hpp"
#include "helix_arm/regulator/modbus_profile.hpp"

namespace helix_arm::io {

/// How a regulator is spoken to: `ascii_serial` or `modbus_tcp` of a scene.
using RegulatorProfile = std::variant<regulator::SerialProfile, regulator::ModbusProfile>;

/// Names of the shipped regulator profiles, in alphabetical order.
std::vector<std::string> shippedProfiles();

/// Whether a profile is given by its path, with a '/' or ending in .yaml, and not by its name.
bool isProfilePath(const std::string& profile);

/// A profile, by its name if it is shipped, otherwise by its path.
/// @throws std::invalid_argument on a name that is not shipped; DocumentError naming the faults of
/// the file.
RegulatorProfile loadRegulatorProfile(const std::string& profile);

}  // namespace helix_arm::io
