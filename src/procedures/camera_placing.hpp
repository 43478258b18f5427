#pragma once

#include <string>
#include <vector>

#include "helix_arm/calibration/suspects.hpp"
#include "helix_arm/io/scene.hpp"
#include "helix_arm/localization/camera_placement.hpp"
#include "helix_arm/vision/tag_detector.hpp"

namespace helix_arm::procedures {

/// Where a scene's camera stands, from pictures of the arm at known pressures.
struct CameraPlacing {
  bool success = false;
  std::string reason;         ///< cause and remedy; empty with success
  std::vector<int> tags;      ///< ids of the tags used, in the order of the fit's
  std::vector<int> outliers;  ///< ids of those that do not fit
  lie::SE3 X_WC;              ///< optical frame (z forward) seen from the world
  /// Covariance of position [m] and rotation [rad] along and about the axes of the world.
  lie::Matrix6 covariance = lie::Matrix6::Zero();
  double moved = 0;   ///< distance from the scene's camera [m]
  double turned = 0;  ///< angle from the scene's camera [rad]
  estimation::CameraPlacement fit;
  std::vector<estimation::Suspect> suspects;  ///< tagSuspectsOf() what was seen
  std::vector<std::string> warnings;
};

/// Largest standard error of a placed camera.
inline constexpr double kMostPositionError = 0.05;    ///< [m]
inline constexpr double kMostRotationError = 0.0873;  ///< [rad]
/// Largest RMS motion of a tag's corners between pictures of one placing [px].
inline constexpr double kMostCornerMotion = 2.0;

/// Places the camera. The corners of a tag are the means over the pictures: more pictures lower the
/// noise but not the stated error, since the errors of corners in one pose are mostly shared.
/// Tags with wrong bits, tags seen twice in one picture, and tags of other arms are not used.
/// @param scene     with camera and tags.
/// @param shape     of the arm, seen from its base.
/// @param pictures  what was detected in each; at least one.
/// @throws std::invalid_argument on a scene without camera or tags.
CameraPlacing placeCamera(const io::Scene& scene, const model::Shape& shape,
                          const std::vector<std::vector<vision::TagDetection>>& pictures);

}  // namespace helix_arm::procedures
