#pragma once

#include <Eigen/Core>
#include <string>

namespace helix_arm::ros_bridge {

/// A camera of rviz that orbits, as its properties tell.
struct ArmCamera {
  std::string target;                               ///< frame whose origin it follows
  Eigen::Vector3d focus = Eigen::Vector3d::Zero();  ///< from there, axes of the fixed frame [m]
  double yaw = 0.0, pitch = 0.0;                    ///< [rad]
  double distance = 0.0;                            ///< of the eye from the focus [m]
};

/// Whether the cockpit of an arm changes this view. It does while the view looks at arm_base, the
/// frame of an arm without a prefix and of rviz configurations that know no arm; or exactly at the
/// base of this arm. A view of another arm, or one that a user moved there, stays.
bool isToChange(const ArmCamera& camera, const std::string& base_frame);

/// The same view at the base of this arm: if it looked exactly at a base, it shows all of the arm
/// from its side; otherwise its focus, angles and distance stay.
/// @param base_frame  of the arm.
/// @param axis        in which the arm leaves its base, fixed frame.
/// @param length      of the arm, > 0 [m].
/// @param aspect      width by height of the picture.
ArmCamera changed(ArmCamera camera, const std::string& base_frame, const Eigen::Vector3d& axis,
                  double length, double aspect);

}  // namespace helix_arm::ros_bridge
