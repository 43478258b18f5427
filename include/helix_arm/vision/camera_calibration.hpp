#pragma once

#include <optional>
#include <string>
#include <vector>

#include <opencv2/core.hpp>

#include "helix_arm/localization/camera.hpp"
#include "helix_arm/localization/tag_layout.hpp"
#include "helix_arm/localization/twist_fit.hpp"
#include "helix_arm/model/shape.hpp"
#include "vision/board_views.hpp"

namespace helix_arm::vision {

/// Approximate pose X_CB of the base seen from the camera, without an initial guess.
///
/// Every tag alone gives two poses; the one with the least median error over all tags is returned.
/// So fewer than half of the tags may be misplaced.
/// @param seen   one entry per tag, indices of the layout.
/// @param focal  converts errors of directions to pixels, > 0 [px].
/// @return nothing if no pose has most tags before the camera.
std::optional<lie::SE3> startOfPlacement(const estimation::TagLayout& layout,
                                         const model::Shape& shape,
                                         const std::vector<estimation::CornerObservation>& seen,
                                         double focal);

struct CameraCalibrationOptions {
  /// Number of coefficients of distortion: 0, 2 (k1 k2), 4 (k1 k2 p1 p2), 5 (and k3) or 8 (and k4
  /// k5 k6). The others are 0.
  int coefficients = 5;

  /// Fewest views that are calibrated with.
  static constexpr int kLeastViews = 5;
  /// Largest standard error of a focal length that counts as determined, relative to it.
  static constexpr double kMostFocalError = 0.02;

  /// @throws std::invalid_argument naming the value and its rule.
  void validate() const;
};

/// One intrinsic parameter.
struct CameraParameter {
  std::string name;  ///< fx, fy, cx, cy, k1, k2, p1, p2, k3, k4, k5 or k6
  std::string unit;  ///< px, or empty
  double value;
  /// The larger of two estimates: the error due to the residuals as independent noise, and that due
  /// to errors that the corners of a view share, such as a board that is not flat (from the views'
  /// gradients). 0 if the parameter is not fitted.
  double standard_error;
};

/// One picture of the calibration.
struct CalibratedView {
  std::string name;
  int parts;    ///< number of the board's parts (BoardParts) that it shows
  int corners;  ///< number of corners
  bool used;
  std::string reason;   ///< why it is not used; empty if it is
  double rms = 0;       ///< of its corners' distances along one axis, if fitted [px]
  double distance = 0;  ///< from the camera to the board, if fitted [m]
  double tilt = 0;      ///< of the board's normal from the line of sight, if fitted [rad]
};

/// Intrinsics of a camera from pictures of a board, and how well they are known.
struct CameraCalibration {
  bool success = false;
  std::string reason;  ///< cause and remedy; empty with success
  estimation::Camera camera;
  std::vector<CameraParameter> parameters;
  double rms = 0;       ///< over the used views, of distances along one axis [px]
  double coverage = 0;  ///< part of the picture's cells that hold corners, as of Coverage
  /// Largest distance of a corner from the principal point, relative to that of the picture's
  /// corner that is farthest from it. Beyond it the distortion is extrapolated.
  double reach = 0;
  int tilted_views = 0;  ///< number of used views that are tilted by 20 degrees or more
  std::vector<CalibratedView> views;
  /// What limits the accuracy, each with its value and remedy.
  std::vector<std::string> warnings;
};

/// Least squares over all views (Zhang's method, by OpenCV). Views whose RMS exceeds 0.3 px and
/// three times the median of all are left out. The scale of the print has no influence: it only
/// scales the distances.
/// @param parts   of the board.
/// @param observations  pictures of the board, all of this size.
/// @throws std::invalid_argument on options that break their rules.
CameraCalibration calibrateCamera(const BoardParts& parts, const cv::Size& size,
                                  const std::vector<BoardObservation>& observations,
                                  const CameraCalibrationOptions& options = {});

}  // namespace helix_arm::vision
