#pragma once

#include <optional>
#include <string>
#include <vector>

#include "arm_reader.hpp"
#include "helix_arm/io/scene.hpp"
#include "io/document/map_reader.hpp"

/// Readers of the keys of a scene beside its arm. A key that the scene omits gives nothing, or the
/// defaults. The arm is null, and the regulator absent, if faults leave none: references to them
/// are then not checked.
namespace helix_arm::io {

/// The optical frame C (z forward, x right, y down) seen from the camera's body (x forward, y left,
/// z up).
extern const Eigen::Matrix3d kOpticalInBody;

/// Reads `camera`.
std::optional<CameraConfig> readCamera(const MapReader& scene);

/// Content of `tags`.
struct TagParts {
  std::string family;
  estimation::TagLayout layout;
  estimation::TagPrior prior;
  lie::SE3 X_BF;  ///< the frame F of tag poses in data sets, seen from the base
};
/// Reads `tags`.
std::optional<TagParts> readTags(const MapReader& scene, const ArmParts* arm);

/// Reads `vision`.
/// @param family  family of the tags; empty if the scene has none.
vision::LocalizerConfig readVision(const MapReader& scene, const std::string& family);

/// Reads `simulation`.
SimulationConfig readSimulation(const MapReader& scene, const ArmParts* arm);

/// Reads `regulator` and the profile that it names.
std::optional<regulator::Config> readRegulator(const MapReader& scene, const ArmParts* arm);

/// Reads `safety`. Without an arm, there are no channels.
SafetyConfig readSafety(const MapReader& scene, const ArmParts* arm,
                        const std::optional<regulator::Config>& regulator);

/// Reads `follow`.
/// @param safety  tells the regulator's lag.
follow::VisualServoConfig readFollow(const MapReader& scene, const SafetyConfig& safety,
                                     const std::optional<regulator::Config>& regulator);

/// Reads `calibration`.
std::optional<Provenance> readProvenance(const MapReader& scene);
/// The value of `calibration` for this provenance; reading it gives the same.
Value writeProvenance(Provenance provenance);

/// The tree of a scene file with its overrides, and the hash of the bytes read.
struct SceneDocument {
  Value document;
  std::string sha256;
};
/// Reads a scene file; overrides that do not apply are faults.
/// @throws DocumentError if the file cannot be read, is not YAML or not a scene.
SceneDocument readSceneDocument(const std::string& path, const std::vector<Override>& overrides,
                                FaultList& faults);

/// The scene that a tree describes.
/// @throws DocumentError with all faults.
Scene makeScene(const Value& document, FaultList& faults);

}  // namespace helix_arm::io
