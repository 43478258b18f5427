#pragma once

#include <cstdint>

#include "helix_arm/estimation/tag_sight.hpp"
#include "helix_arm/model/arm.hpp"

namespace helix_arm::simulation {

/// How far camera and tags of the true rig sit from where its scene puts them: standard deviations
/// of normal noise, each axis alike.
struct MountDeviation {
  double camera_translation = 0.0;  ///< >= 0 [m]
  double camera_rotation = 0.0;     ///< >= 0 [rad]
  double tag_translation = 0.0;     ///< along the arm and across it, >= 0 [m]
  double tag_rotation = 0.0;        ///< >= 0 [rad]
  std::uint32_t seed = 1;

  /// @throws std::invalid_argument naming the value and its rule.
  void validate() const;
};

/// Tags as they are truly glued: each moved as estimation::movedBy() has it, by its own noise. All
/// but the one nearest to the base, which defines where that is.
///
/// The same seed gives the same rig: the noise of a tag depends on its place in the list and grows
/// with the deviations.
/// @throws std::invalid_argument naming the value and its rule.
estimation::TagLayout deviate(const estimation::TagLayout& layout, const model::Arm& arm,
                              const MountDeviation& deviation);

/// The same tags, seen by the camera where it truly stands: X_CB exp(xi) is the base seen from it,
/// xi = [v; w] noise of the camera's deviations.
/// @throws std::invalid_argument naming the value and its rule.
estimation::ArmView deviate(const estimation::ArmView& view, const model::Arm& arm,
                            const MountDeviation& deviation);

}  // namespace helix_arm::simulation
