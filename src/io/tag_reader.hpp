#pragma once

#include <optional>
#include <string>

#include "arm_reader.hpp"
#include "helix_arm/estimation/calibration.hpp"

namespace helix_arm::io {

/// Content of `tags`.
struct TagParts {
  std::string family;
  estimation::TagLayout layout;
  estimation::TagPrior prior;
  lie::SE3 X_BF;  ///< the frame F of tag poses in data sets, seen from the base
};

/// Reads `tags`; nothing if the scene has none.
/// @param arm  null if faults leave none: then references of tags to it are not checked.
std::optional<TagParts> readTags(const MapReader& scene, const Value& document, const ArmParts* arm,
                                 FaultList& faults);

}  // namespace helix_arm::io
