#include "profile_file.hpp"

#include <algorithm>
#include <filesystem>

#include "helix_arm/basics/quote.hpp"
#include "helix_arm/io/shipped_files.hpp"
#include "modbus_profile_reader.hpp"
#include "serial_profile_reader.hpp"
#include "text_file.hpp"

namespace helix_arm::io {
namespace {

namespace fs = std::filesystem;

constexpr const char* kSerial = "ascii_serial";
constexpr const char* kModbus = "modbus_tcp";
constexpr std::size_t kLongestProfile = 200;  // of a path, in a message

bool isPath(const std::string& profile) {
  return profile.find('/') != std::string::npos || fs::path(profile).extension() == ".yaml";
}

// The value of a key; null without a map or without the key.
Value* child(Value* map, const char* key) {
  return map == nullptr ? nullptr : const_cast<Value*>(map->find(key));
}

template <class Profile>
using Reader = std::optional<Profile> (*)(const Value&, const std::string&, const std::string&,
                                          FaultList&);

// Content of a profile file below its single top-level key.
template <class Profile>
std::optional<Profile> readFile(const fs::path& path, const char* kind, Reader<Profile> reader,
                                FaultList& faults) {
  const std::optional<std::string> text = readTextFile(path, kMostSceneBytes, faults);
  if (!text) return std::nullopt;
  const std::optional<Value> document =
      parseDocument(*text, {{kSerial, kModbus}, {kSerial, kModbus}, 1}, faults);
  if (!document) return std::nullopt;
  const MapReader file(*document, "", {kSerial, kModbus}, faults);
  const std::optional<std::string> found = file.exactlyOne({kSerial, kModbus});
  if (!found) return std::nullopt;
  if (*found != kind) {
    file.complain(
        *found, "is not the scene's kind of regulator; expected a profile of " + std::string(kind));
    return std::nullopt;
  }
  std::optional<Profile> profile =
      reader(*document->find(kind), kind, path.stem().string(), faults);
  return faults.empty() ? std::move(profile) : std::nullopt;
}

template <class Profile>
std::optional<Profile> readProfile(const MapReader& keys, const char* kind, Reader<Profile> reader,
                                   FaultList& faults) {
  const std::vector<std::string> shipped = shippedProfiles();
  const std::string expected =
      alternatives(shipped) + ", or a path (with a / or ending in .yaml) from the scene's folder";
  const std::optional<std::string> profile = keys.text("profile", expected);
  if (!profile) return std::nullopt;
  if (!isPath(*profile) && std::find(shipped.begin(), shipped.end(), *profile) == shipped.end()) {
    keys.fault("profile", expected);
    return std::nullopt;
  }
  const fs::path path = isPath(*profile)
                            ? fs::path(*profile)
                            : fs::path(shippedFolder(kShippedRegulators)) / (*profile + ".yaml");
  FaultList in_file(path.string());
  std::optional<Profile> read = readFile(path, kind, reader, in_file);
  if (!in_file.empty())
    keys.complain("profile",
                  "is " + basics::quoted(*profile, kLongestProfile) + ", which has faults:");
  faults.append(in_file);
  return read;
}

}  // namespace

std::vector<std::string> shippedProfiles() { return shippedNames(kShippedRegulators); }

Value* relativeProfile(Value& scene) {
  Value* const regulator = child(&scene, "regulator");
  for (const char* kind : {kSerial, kModbus}) {
    Value* const profile = child(child(regulator, kind), "profile");
    const bool relative = profile != nullptr && profile->kind == Value::Kind::kText &&
                          isPath(profile->text) && fs::path(profile->text).is_relative();
    if (relative) return profile;
  }
  return nullptr;
}

std::optional<regulator::SerialProfile> readSerialProfileFile(const MapReader& keys,
                                                              FaultList& faults) {
  return readProfile<regulator::SerialProfile>(keys, kSerial, readSerialProfile, faults);
}

std::optional<regulator::ModbusProfile> readModbusProfileFile(const MapReader& keys,
                                                              FaultList& faults) {
  return readProfile<regulator::ModbusProfile>(keys, kModbus, readModbusProfile, faults);
}

}  // namespace helix_arm::io
