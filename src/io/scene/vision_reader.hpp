#pragma once

#include <optional>
#include <string>

#include "arm_reader.hpp"
#include "helix_arm/calibration/calibration.hpp"
#include "helix_arm/io/scene.hpp"
#include "io/document/map_reader.hpp"

namespace helix_arm::io {

/// The optical frame C (z forward, x right, y down) seen from the camera's body (x forward, y left,
/// z up).
extern const Eigen::Matrix3d kOpticalInBody;

/// Reads `camera`; nothing if the scene has none.
std::optional<CameraConfig> readCamera(const MapReader& scene, const Value& document,
                                       FaultList& faults);

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

/// Reads `vision`; defaults for what the scene omits.
/// @param family  family of the tags; empty if the scene has none.
vision::LocalizerConfig readVision(const MapReader& scene, const Value& document,
                                   const std::string& family, FaultList& faults);

/// Reads `simulation`; defaults for what the scene omits.
/// @param arm  null if the arm has faults.
SimulationConfig readSimulation(const MapReader& scene, const Value& document, const ArmParts* arm,
                                FaultList& faults);

/// Reads `follow`; defaults for what the scene omits.
/// @param safety     tells the regulator's lag.
/// @param regulator  absent if there is none, or if it has faults.
follow::VisualServoConfig readFollow(const MapReader& scene, const Value& document,
                                     const SafetyConfig& safety,
                                     const std::optional<regulator::Config>& regulator,
                                     FaultList& faults);

}  // namespace helix_arm::io
