#pragma once

#include <Eigen/Core>

#include <std_msgs/ColorRGBA.h>
#include <visualization_msgs/Marker.h>

namespace helix_arm::ros_bridge {

std_msgs::ColorRGBA color(double r, double g, double b, double a = 1.0);

/// A marker with action ADD, at the origin of its frame.
visualization_msgs::Marker makeMarker(const std_msgs::Header& header, const char* ns, int id,
                                      int type, const ros::Duration& lifetime);

/// Makes a sphere the ellipsoid of two standard deviations about its centre.
/// @param covariance  of a position, in the marker's frame [m^2].
/// @param centre      in the same frame [m].
void shapeLike(const Eigen::Matrix3d& covariance, const Eigen::Vector3d& centre,
               visualization_msgs::Marker& sphere);

}  // namespace helix_arm::ros_bridge
