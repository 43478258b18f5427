#pragma once

#include <optional>
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

/// A stiffness out of proportion to the ring, the pressures, the muscles and the load of its
/// section, as one in another unit is.
struct StiffnessDoubt {
  std::string section, key;   ///< "K_kappa_m2"
  std::string value, remedy;  ///< "98 m^2; expected at most 0.04", "give it in m^2: .."
};
/// @param load   nothing: K_eps is not judged.
/// @param slack  factor by which the bounds are wider; loading a scene refuses what exceeds 2.
std::vector<StiffnessDoubt> stiffnessDoubts(const model::Arm& arm,
                                            const std::vector<SectionLook>& looks,
                                            const std::optional<statics::Load>& load,
                                            double slack = 1);

}  // namespace helix_arm::io
