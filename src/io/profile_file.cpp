#include "profile_file.hpp"

#include <algorithm>
#include <filesystem>

#include "helix_arm/basics/quote.hpp"
#include "helix_arm/basics/requirement.hpp"
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

fs::path pathOf(const std::string& profile) {
  return isProfilePath(profile) ? fs::path(profile)
                                : fs::path(shippedFolder(kShippedRegulators)) / (profile + ".yaml");
}

// The value of a key; null without a map or without the key.
Value* child(Value* map, const char* key) {
  return map == nullptr ? nullptr : const_cast<Value*>(map->find(key));
}

template <class Profile>
using Reader = std::optional<Profile> (*)(const Value&, const std::string&, const std::string&,
                                          FaultList&);

std::optional<Value> readDocument(const fs::path& path, FaultList& faults) {
  const std::optional<std::string> text = readTextFile(path, kMostSceneBytes, faults);
  if (!text) return std::nullopt;
  return parseDocument(*text, {{kSerial, kModbus}, {kSerial, kModbus}, 1}, faults);
}

// Content of a profile file's document below its single top-level key.
template <class Profile>
std::optional<Profile> readContent(const Value& document, const fs::path& path, const char* kind,
                                   Reader<Profile> reader, FaultList& faults) {
  const MapReader file(document, "", {kSerial, kModbus}, faults);
  const std::optional<std::string> found = file.exactlyOne({kSerial, kModbus});
  if (!found) return std::nullopt;
  if (*found != kind) {
    file.complain(
        *found, "is not the scene's kind of regulator; expected a profile of " + std::string(kind));
    return std::nullopt;
  }
  std::optional<Profile> profile = reader(*document.find(kind), kind, path.stem().string(), faults);
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
  if (!isProfilePath(*profile) &&
      std::find(shipped.begin(), shipped.end(), *profile) == shipped.end()) {
    keys.fault("profile", expected);
    return std::nullopt;
  }
  const fs::path path = pathOf(*profile);
  FaultList in_file(path.string());
  std::optional<Profile> read;
  if (const std::optional<Value> document = readDocument(path, in_file)) {
    read = readContent(*document, path, kind, reader, in_file);
  }
  if (!in_file.empty())
    keys.complain("profile",
                  "is " + basics::quoted(*profile, kLongestProfile) + ", which has faults:");
  faults.append(in_file);
  return read;
}

}  // namespace

std::vector<std::string> shippedProfiles() { return shippedNames(kShippedRegulators); }

bool isProfilePath(const std::string& profile) {
  return profile.find('/') != std::string::npos || fs::path(profile).extension() == ".yaml";
}

RegulatorProfile loadRegulatorProfile(const std::string& profile) {
  const std::vector<std::string> shipped = shippedProfiles();
  basics::require(
      isProfilePath(profile) || std::find(shipped.begin(), shipped.end(), profile) != shipped.end(),
      "the regulator profile ", basics::quoted(profile, kLongestProfile),
      " is not shipped; expected ", alternatives(shipped),
      ", or a path (with a / or ending in .yaml)");
  const fs::path path = pathOf(profile);
  FaultList faults(path.string());
  std::optional<RegulatorProfile> read;
  const std::optional<Value> document = readDocument(path, faults);
  if (document && document->find(kModbus) != nullptr) {
    read =
        readContent<regulator::ModbusProfile>(*document, path, kModbus, readModbusProfile, faults);
  } else if (document) {
    read =
        readContent<regulator::SerialProfile>(*document, path, kSerial, readSerialProfile, faults);
  }
  faults.throwIfAny();
  return read.value();
}

Value* relativeProfile(Value& scene) {
  Value* const regulator = child(&scene, "regulator");
  for (const char* kind : {kSerial, kModbus}) {
    Value* const profile = child(child(regulator, kind), "profile");
    const bool relative = profile != nullptr && profile->kind == Value::Kind::kText &&
                          isProfilePath(profile->text) && fs::path(profile->text).is_relative();
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
