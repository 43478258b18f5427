#pragma once

#include <optional>
#include <string>
#include <vector>

#include "helix_arm/io/fault_list.hpp"
#include "helix_arm/lie/se3.hpp"
#include "helix_arm/model/arm.hpp"
#include "helix_arm/statics/arm_model.hpp"
#include "helix_arm/statics/load.hpp"
#include "helix_arm/statics/tier.hpp"
#include "io/document/document.hpp"
#include "io/document/map_reader.hpp"
#include "section_reader.hpp"

namespace helix_arm::io {

/// Content of `arm`.
struct ArmParts {
  lie::SE3 X_WB;
  model::Arm arm;
  std::optional<model::PlanarArm> planar;
  std::vector<SectionLook> looks;
  std::vector<double> K_eps;                    ///< per section [N]; empty if one has none
  std::vector<statics::StiffnessTable> tables;  ///< per section; empty if all are constant
};

/// Reads `arm`; nothing if faults leave no arm.
std::optional<ArmParts> readArm(const MapReader& scene, const Contractions& contractions,
                                FaultList& faults);

/// Reads `load`; values given in the world frame are rotated into the arm's base. If the scene has
/// none but the arm has K_eps, a load that is empty except for K_eps. Nothing if it has neither, or
/// faults leave none.
/// @param arm  null if faults leave no arm; the faults of `load` itself are still found.
std::optional<statics::Load> readLoad(const MapReader& scene, const Value& document,
                                      const ArmParts* arm, FaultList& faults);

/// Reads `tier`, `order`, `accuracy` and `budget`, which choose how shapes are computed.
/// @param arm  null if faults leave no arm; then the request is not checked against it.
statics::TierRequest readTierRequest(const MapReader& scene, const Value& document,
                                     const ArmParts* arm, FaultList& faults);

/// How scenes are recognised.
const DocumentKind& sceneKind();

/// The text of a scene file. @throws DocumentError if it cannot be read.
std::string readSceneText(const std::string& path, FaultList& faults);

/// The tree of a scene's text; nothing, and a fault that does not repeat its content, if it is not
/// a scene.
std::optional<Value> parseScene(const std::string& text, FaultList& faults);

/// The same with overrides; overrides that do not apply are faults.
/// @throws DocumentError if the text is not YAML or not a scene.
Value parseScene(const std::string& text, const std::vector<Override>& overrides,
                 FaultList& faults);

/// The arm of a scene.
struct SceneArmParts {
  std::optional<std::string> name;
  Contractions contractions;
  std::optional<ArmParts> arm;
  std::optional<statics::ArmModel> model;
};

/// Reads the keys that loadArm() names. Each part is absent if faults concern it.
SceneArmParts readSceneArm(const MapReader& scene, const Value& document, FaultList& faults);

}  // namespace helix_arm::io
