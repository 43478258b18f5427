#pragma once

#include <std_msgs/ColorRGBA.h>
#include <visualization_msgs/Marker.h>

namespace helix_arm::ros_bridge {

std_msgs::ColorRGBA color(double r, double g, double b, double a = 1.0);

/// A marker with action ADD, at the origin of its frame.
visualization_msgs::Marker makeMarker(const std_msgs::Header& header, const char* ns, int id,
                                      int type, const ros::Duration& lifetime);

}  // namespace helix_arm::ros_bridge
