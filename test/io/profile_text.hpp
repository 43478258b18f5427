#pragma once

#include <fstream>
#include <iterator>
#include <optional>
#include <stdexcept>
#include <string>
#include <vector>

#include "io/document/document.hpp"
#include "scene_faults.hpp"

namespace helix_arm::test {

/// What reading a profile gives.
template <class Profile>
struct ReadProfile {
  std::optional<Profile> profile;
  std::vector<std::string> faults;
};

/// What a reader makes of the map below a key of the file "f"; the profile is called "mine".
template <class Profile>
ReadProfile<Profile> readProfile(const std::string& text, const std::string& key,
                                 std::optional<Profile> (*reader)(const io::Value&,
                                                                  const std::string& path,
                                                                  const std::string& name,
                                                                  io::FaultList&)) {
  io::FaultList faults("f");
  const std::optional<io::Value> document = io::parseDocument(text, {}, faults);
  const io::Value* map = document ? document->find(key) : nullptr;
  if (map == nullptr) return {std::nullopt, {"no map " + key}};
  ReadProfile<Profile> result;
  result.profile = reader(*map, key, "mine", faults);
  result.faults = faults.faults();
  return result;
}

/// The text of a profile that is shipped.
/// @throws std::runtime_error when there is none.
inline std::string shippedProfile(const std::string& name) {
  const std::string path = HELIX_ARM_SOURCE_DIR "/config/regulators/" + name + ".yaml";
  std::ifstream file(path);
  if (!file) throw std::runtime_error("cannot read " + path);
  return {std::istreambuf_iterator<char>(file), {}};
}

}  // namespace helix_arm::test
