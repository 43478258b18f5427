#pragma once

#include <optional>
#include <string>
#include <vector>

#include "helix_arm/dynamics/motion_config.hpp"
#include "helix_arm/model/arm.hpp"
#include "helix_arm/response/mode_fit.hpp"
#include "helix_arm/statics/load.hpp"

namespace helix_arm::estimation {

/// What fitInertia() fits.
struct InertiaParts {
  bool mass, damping;
};

/// Masses and damping of an arm.
struct InertiaFit {
  std::string failure;         ///< why there is none; empty if there is one
  Estimate mass{1.0, 0.0};     ///< factor on the masses of the sections
  Estimate damping{1.0, 0.0};  ///< factor on the time constants of the damping
  /// The slowest vibration of the fitted arm at the pressures of each release that rings, in their
  /// order.
  std::vector<dynamics::Vibration> predicted;
};

/// Fits masses and damping to frequencies and damping ratios of an arm that rings: the slowest
/// vibration of its small motions about the rest where a release ends (dynamics::LinearMotion) has
/// the natural frequency of that release, which gives a factor on the masses of the sections, and
/// its damping ratio, which gives one on the time constants. Factors of several releases are means
/// weighted by their errors, which include the scatter between releases.
///
/// @param config  with a damping that is not 0. @param rings  found by fitMode(); where their
///     inputs are unknown, the arm counts as at its lower limits.
/// @throws as dynamics::ArmMotion does.
InertiaFit fitInertia(const model::Arm& arm, const std::optional<model::PlanarArm>& planar,
                      const statics::Load& load, const dynamics::MotionConfig& config,
                      const ModeFit& rings, const InertiaParts& parts);

}  // namespace helix_arm::estimation
