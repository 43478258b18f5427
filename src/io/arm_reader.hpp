#pragma once

#include <optional>
#include <vector>

#include "contraction_reader.hpp"
#include "helix_arm/io/section_look.hpp"
#include "helix_arm/lie/se3.hpp"
#include "helix_arm/model/arm.hpp"
#include "helix_arm/statics/load.hpp"
#include "map_reader.hpp"

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

}  // namespace helix_arm::io
