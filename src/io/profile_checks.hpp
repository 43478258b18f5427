#pragma once

#include <cstddef>
#include <optional>
#include <stdexcept>
#include <string>

#include "document.hpp"
#include "helix_arm/io/fault_list.hpp"
#include "map_reader.hpp"

/// Checks common to the profiles of all kinds of regulators.
namespace helix_arm::io {

inline const NumberRule kAtmosphere = within(kNotNegative, 0, 200, " kPa");
inline constexpr int kMostProfileChannels = 1024;
inline const NumberRule kTimeout = within(kPositive, 1e-3, 10, " s");

/// A profile that was read from a map, if it is valid.
///
/// @param path           path of that map, for messages.
/// @param faults_before  number of faults before it was read.
/// @return nothing, and at least one fault, if a rule is broken.
template <class Profile>
std::optional<Profile> checked(const Profile& profile, const Value& map, const std::string& path,
                               std::size_t faults_before, FaultList& faults) {
  if (faults.count() > faults_before) return std::nullopt;
  try {
    profile.validate();
  } catch (const std::invalid_argument& error) {
    report(faults, map.place, path + ": " + error.what());
    return std::nullopt;
  }
  return profile;
}

}  // namespace helix_arm::io
