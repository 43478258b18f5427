#pragma once

#include <cstdint>

#include "helix_arm/estimation/arm_view.hpp"
#include "helix_arm/model/arm.hpp"

namespace helix_arm::simulation {

/// Placement errors of camera and tags of the true rig against its scene: standard deviations of
/// normal noise, equal for all axes.
struct MountDeviation {
  double camera_translation = 0.0;  ///< >= 0 [m]
  double camera_rotation = 0.0;     ///< >= 0 [rad]
  double tag_translation = 0.0;     ///< along the arm and across it, >= 0 [m]
  double tag_rotation = 0.0;        ///< >= 0 [rad]
  std::uint32_t seed = 1;

  /// @throws std::invalid_argument naming the value and its rule.
  void validate() const;
};

/// The true placements of the tags: each is moved by its own noise, as estimation::movedBy() does,
/// except the tag nearest to the base, which defines the base's position.
///
/// The same seed gives the same rig: the noise of a tag depends on its index and scales with the
/// deviations.
/// @throws std::invalid_argument naming the value and its rule.
estimation::TagLayout deviate(const estimation::TagLayout& layout, const model::Arm& arm,
                              const MountDeviation& deviation);

/// The same tags seen by the camera at its true pose: X_CB exp(xi) is the base seen from it, where
/// xi = [v; w] is noise with the camera's deviations.
/// @throws std::invalid_argument naming the value and its rule.
estimation::ArmView deviate(const estimation::ArmView& view, const model::Arm& arm,
                            const MountDeviation& deviation);

}  // namespace helix_arm::simulation
