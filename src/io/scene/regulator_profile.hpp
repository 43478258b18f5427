#pragma once

#include <string>
#include <vector>

#include "helix_arm/regulator/config.hpp"

namespace helix_arm::io {

/// Names of the shipped regulator profiles, in alphabetical order.
std::vector<std::string> shippedProfiles();

/// Whether a profile is given by its path, with a '/' or ending in .yaml, and not by its name.
bool isProfilePath(const std::string& profile);

/// A profile, by its name if it is shipped, otherwise by its path.
/// @throws std::invalid_argument on a name that is not shipped; DocumentError naming the faults of
/// the file.
regulator::Profile loadRegulatorProfile(const std::string& profile);

}  // namespace helix_arm::io
