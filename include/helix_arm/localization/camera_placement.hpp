#pragma once

#include <Eigen/Core>
#include <vector>

#include "helix_arm/lie/se3.hpp"
#include "helix_arm/localization/tag_layout.hpp"
#include "helix_arm/localization/twist_fit.hpp"
#include "helix_arm/model/arm.hpp"
#include "helix_arm/model/shape.hpp"

namespace helix_arm::estimation {

/// Prior of the true shape of an arm about the model's, per section: standard deviations.
struct ShapePrior {
  double translation = 0.02;  ///< of each entry of v, relative to the section's length
  double rotation = 0.1;      ///< of each entry of w [rad]
};

/// Assumptions of placeCamera().
struct CameraPlacementOptions {
  double corner_noise = 0.3;  ///< expected standard deviation of a corner's coordinate [px]
  TagPrior tag_prior;         ///< of every tag except the one nearest to the base
  ShapePrior shape_prior;     ///< of the arm
  double border_shift_prior = 0.0005;  ///< standard deviation of the width of white bleeding [m]
};

/// Whether a camera was placed.
enum class PlacementStatus {
  kPlaced,
  kUnexplained,   ///< no pose fits more than half of the tags
  kNotConverged,  ///< the last estimate is returned, but it is not a minimum
};

/// Pose of a camera from one arm whose shape is known approximately.
struct CameraPlacement {
  PlacementStatus status = PlacementStatus::kNotConverged;
  lie::SE3 X_CB;  ///< the arm's base seen from the camera
  /// Covariance of the error xi [v; w] of X_CB = X_CB_true exp(xi) [m, rad]: of a motion of the
  /// base, seen from the base. It includes the priors of placements, shape and border shift, and
  /// the noise of the corners; it grows with the residuals if these are larger than expected.
  lie::Matrix6 covariance = lie::Matrix6::Zero();
  double border_shift = 0;  ///< [m]
  /// Largest deviation of an entry of the fitted twists from the model's, in standard deviations of
  /// its prior.
  double shape_deviations = 0;
  double rms = 0;  ///< over the tags that fit: corners [px]
  std::vector<TagResidual> tags;
};

/// Maximum a posteriori estimate of the camera's pose, together with the displacements of the tags,
/// the arm's shape and the border shift under their priors. The tag nearest to the base counts as
/// exact: it defines the base.
///
/// @param arm    only its rest lengths are used, for the prior of the shape.
/// @param shape  the model's shape, which the prior is about.
/// @param seen   one entry per tag, no tag twice, all finite; 2 or more.
/// @param focal  converts errors of directions to pixels, > 0 [px].
/// @param start  approximate X_CB.
CameraPlacement fitCameraPlacement(const model::Arm& arm, const TagLayout& layout,
                                   const model::Shape& shape,
                                   const std::vector<CornerObservation>& seen, double focal,
                                   const lie::SE3& start,
                                   const CameraPlacementOptions& options = {});

/// RMS of the distances along one axis [px] between the corners of a tag as observed and as
/// expected at its nominal placement; infinite if a corner is behind the camera.
double cornerError(const TagLayout& layout, const model::Shape& shape, const lie::SE3& X_CB,
                   const CornerObservation& seen, double focal);

/// Covariance of [position; rotation] of a camera in the world: errors of its position [m] and
/// rotation [rad], both along and about the axes of the world.
/// @param covariance  as of CameraPlacement.
lie::Matrix6 cameraCovariance(const lie::SE3& X_WB, const lie::SE3& X_CB,
                              const lie::Matrix6& covariance);

}  // namespace helix_arm::estimation
