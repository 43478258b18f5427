#pragma once

#include <optional>
#include <string>

#include "arm_reader.hpp"

namespace helix_arm::io {

/// What `tags` says.
struct TagParts {
  std::string family;
  estimation::TagLayout layout;
};

/// Reads `tags`; nothing where the scene has none.
/// @param arm  null where its faults leave none: then what tags say of it is not checked.
std::optional<TagParts> readTags(const MapReader& scene, const Value& document, const ArmParts* arm,
                                 FaultList& faults);

}  // namespace helix_arm::io
