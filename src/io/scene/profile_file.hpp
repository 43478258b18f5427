#pragma once

#include <optional>
#include <string>

#include "helix_arm/io/fault_list.hpp"
#include "helix_arm/io/regulator_profile.hpp"
#include "io/document/document.hpp"
#include "io/document/map_reader.hpp"

namespace helix_arm::io {

/// The profile of a device: the map below the single key of a document, `ascii_serial` of one on a
/// serial line or `modbus_tcp`.
///
/// @param kind  the key that is needed; null for any.
/// @param name  the profile's.
/// @return nothing, and at least one fault, if a rule is broken.
std::optional<RegulatorProfile> readProfile(const Value& document, const char* kind,
                                            const std::string& name, FaultList& faults);

/// The profile that a scene names by a path relative to the scene's folder (with a '/' or ending in
/// .yaml); null if there is none. Such a path becomes invalid if the scene is moved.
Value* relativeProfile(Value& scene);

/// The profile that the key `profile` of a kind of regulator names: shipped, or a path. Faults in
/// it are reported with its own file and lines.
/// @return nothing, and at least one fault, if there is no such profile of this kind.
std::optional<RegulatorProfile> readProfileFile(const MapReader& keys, const std::string& kind);

}  // namespace helix_arm::io
