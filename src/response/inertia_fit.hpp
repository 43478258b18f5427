#pragma once

#include <optional>
#include <string>
#include <vector>

#include "helix_arm/dynamics/motion_config.hpp"
#include "helix_arm/model/arm.hpp"
#include "helix_arm/statics/load.hpp"
#include "mode_fit.hpp"

namespace helix_arm::estimation {

/// Parameters that fitInertia() fits.
struct InertiaParts {
  bool mass, damping;
};

/// Masses and damping of an arm.
struct InertiaFit {
  std::string failure;         ///< why there is none; empty if there is one
  Estimate mass{1.0, 0.0};     ///< factor on the masses of the sections
  Estimate damping{1.0, 0.0};  ///< factor on the time constants of the damping
  /// Vibration of the fitted arm after each release that rings, in their order.
  std::vector<dynamics::Vibration> predicted;
};

/// Fits masses and damping to frequencies and damping ratios of an arm that rings: factors on the
/// masses of the sections and on the time constants with which it rings alike. Where steps of
/// pressure made it ring, the arm moves through the same pressures (dynamics::ArmMotion), and its
/// rings are fitted by the same rows, refitted(), so that swings may be large; elsewhere its
/// slowest small vibration about the rest where the release ends counts (dynamics::LinearMotion).
/// Factors of several releases are pooled().
///
/// @param config   with a damping that is not 0. @param history  of the recording; where its inputs
///     are unknown, the arm counts as at its lower limits. @param rings  of the recording.
/// @throws as dynamics::ArmMotion does.
InertiaFit fitInertia(const model::Arm& arm, const std::optional<model::PlanarArm>& planar,
                      const statics::Load& load, const dynamics::MotionConfig& config,
                      const model::InputHistory& history, const ModeFit& rings,
                      const InertiaParts& parts);

}  // namespace helix_arm::estimation
