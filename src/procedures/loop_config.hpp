#pragma once

#include <optional>
#include <string>
#include <vector>

#include "helix_arm/follow/visual_servo_config.hpp"
#include "helix_arm/io/scene.hpp"
#include "helix_arm/localization/placed_view.hpp"
#include "helix_arm/vision/arm_localizer.hpp"

namespace helix_arm::procedures {

/// The configuration of the visual servo of a scene: its key `follow`, and where the scene was
/// calibrated, the relative standard errors of stiffness and lengths as deviations at the start.
/// @throws std::invalid_argument if the scene has no pressure actuators.
follow::VisualServoConfig loopConfigOf(const io::Scene& scene);

/// How pictures of the scene's arm are searched and fitted where they come one after another: base
/// and border shift, as far as they are fitted, are learnt over the pictures. The base's prior is
/// that of the scene, or the standard error of a calibration that found it.
vision::LocalizerConfig localizerConfigOf(const io::Scene& scene);

/// Warning of that configuration before the arm moves; empty if nothing.
std::string loopWarning(const follow::VisualServoConfig& config);

/// Ids of the tags, of those with these indices, that no capture of the calibration shows: they
/// count by the prior of their placement. Empty if no calibration placed the tags.
std::vector<int> uncalibratedTags(const estimation::TagLayout& layout, const std::vector<int>& of);
/// The meaning of such ids, and the remedy; empty without ids.
std::string uncalibratedText(const std::vector<int>& ids);

/// The scene's view of its arm, with the standard errors of its calibration where that fitted
/// placements, and its priors of them otherwise; a base that is fitted counts as learnt from the
/// pictures. Nothing without a camera or tags.
std::optional<estimation::PlacedView> placedViewOf(const io::Scene& scene);

}  // namespace helix_arm::procedures
