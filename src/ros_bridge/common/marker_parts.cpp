#include "helix_arm/ros_bridge/common/marker_parts.hpp"

namespace helix_arm::ros_bridge {

std_msgs::ColorRGBA color(double r, double g, double b, double a) {
  std_msgs::ColorRGBA out;
  out.r = static_cast<float>(r);
  out.g = static_cast<float>(g);
  out.b = static_cast<float>(b);
  out.a = static_cast<float>(a);
  return out;
}

visualization_msgs::Marker makeMarker(const std_msgs::Header& header, const char* ns, int id,
                                      int type, const ros::Duration& lifetime) {
  visualization_msgs::Marker out;
  out.header = header;
  out.ns = ns;
  out.id = id;
  out.type = type;
  out.action = visualization_msgs::Marker::ADD;
  out.pose.orientation.w = 1.0;
  out.lifetime = lifetime;
  return out;
}

}  // namespace helix_arm::ros_bridge
