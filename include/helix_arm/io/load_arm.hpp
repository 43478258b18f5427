#pragma once

#include <string>
#include <vector>

#include "helix_arm/io/fault_list.hpp"
#include "helix_arm/lie/se3.hpp"
#include "helix_arm/statics/arm_model.hpp"

namespace helix_arm::io {

/// The arm of a scene file, without its rig.
struct SceneArm {
  std::string name;         ///< of the scene
  lie::SE3 X_WB;            ///< arm base B seen from the world W
  statics::ArmModel model;  ///< pressures [Pa] to shapes, with the tier that the scene asks for
  std::vector<SectionLook> looks;  ///< (sections)
};

/// Reads the keys of a scene file that describe its arm: `name`, `contractions`, `arm`, `load`,
/// `tier`, `order`, `accuracy` and `budget`. Tags, camera, vision, simulation, regulator, safety
/// and calibration are neither read nor checked; use loadScene() for these.
///
/// Needs Eigen and yaml-cpp alone (library helix_arm::core).
/// @throws DocumentError with all faults: `file:line key value rule`.
SceneArm loadArm(const std::string& path, const std::vector<Override>& overrides = {});

}  // namespace helix_arm::io
