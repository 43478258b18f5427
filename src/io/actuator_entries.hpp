#pragma once

#include <string>
#include <vector>

#include "document.hpp"

namespace helix_arm::io {

/// A map in the document of a scene that describes actuators: a ring or a single one.
struct ActuatorEntry {
  Value* keys;
  std::string path;
  int first;  ///< index of its first actuator in the arm
  int count;
};

/// The sections of the document of a valid scene.
std::vector<Value::Entry>& sectionsOf(Value& document);

/// All actuators of the document of a valid scene, in the order of the arm.
std::vector<ActuatorEntry> actuatorEntries(Value& document);

}  // namespace helix_arm::io
