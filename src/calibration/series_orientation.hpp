#pragma once

#include <Eigen/Core>
#include <string>
#include <vector>

#include "helix_arm/localization/body_check.hpp"

/// Orientations of a body that the tip carries, against those of the tip.
namespace helix_arm::estimation {

using Rotations = std::vector<Eigen::Matrix3d>;

/// The rotation nearest to a matrix (Frobenius norm).
Eigen::Matrix3d nearestRotation(const Eigen::Matrix3d& matrix);

/// The rotation vector of R [rad], and the rotation of such a vector.
Eigen::Vector3d rotationVector(const Eigen::Matrix3d& R);
Eigen::Matrix3d rotationOf(const Eigen::Vector3d& vector);

/// The rotation seen in frames in which one axis points the other way.
Eigen::Matrix3d mirrored(const Eigen::Matrix3d& R, int axis);

/// The rotation R_TM nearest to all R_FT^T R_FM: between tip and body, if both move alike.
Eigen::Matrix3d meanBody(const Rotations& R_FT, const Rotations& R_FM);

/// RMS angle of rotations about their mean [rad].
double spreadOf(const Rotations& rotations);

/// The usual mistake of recordings, with its remedy, that explains orientations R_FM of a body that
/// does not move as the tip does.
std::string faultOfOrientations(const Rotations& R_FT, const Rotations& R_FM);

}  // namespace helix_arm::estimation
