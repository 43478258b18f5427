#pragma once

#include <optional>
#include <string>
#include <vector>

#include "helix_arm/estimation/camera.hpp"
#include "helix_arm/io/override.hpp"
#include "helix_arm/lie/se3.hpp"

namespace helix_arm::io {

/// New values of a scene's camera; absent members leave the scene as it is.
struct CameraChange {
  std::optional<estimation::Camera> intrinsics;
  std::optional<lie::SE3> X_WC;  ///< optical frame C (z forward) seen from the world
};

/// The text of a scene file with the change applied: loading it gives a scene with these values.
/// The comments of the file are not kept.
/// @throws DocumentError if the file cannot be read or breaks its rules before or after the change.
/// @throws std::invalid_argument on a scene without a camera.
std::string sceneTextWithCamera(const std::string& path, const std::vector<Override>& overrides,
                                const CameraChange& change);

/// The text of a calibration file of camera_info_manager and camera_calibration_parsers (YAML):
/// plumb_bob, or rational_polynomial if k4, k5 or k6 is not 0.
/// @param name  of the camera: letters, digits and _.
std::string cameraInfoText(const estimation::Camera& camera, const std::string& name);

/// Position [m] and roll, pitch, yaw [degrees] of a camera as in a scene's section camera: x is the
/// optical axis.
struct CameraPlace {
  Eigen::Vector3d position;
  Eigen::Vector3d rpy_deg;
};
CameraPlace cameraPlaceOf(const lie::SE3& X_WC);

}  // namespace helix_arm::io
