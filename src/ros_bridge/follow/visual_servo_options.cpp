#include "ros_bridge/follow/visual_servo_options.hpp"

#include "ros_bridge/common/file_access.hpp"
#include "ros_bridge/common/parameters.hpp"

namespace helix_arm::ros_bridge {

VisualServoOptions VisualServoOptions::load() {
  ParameterReader reader{ros::NodeHandle("~")};
  VisualServoOptions out;
  out.scene = reader.file("scene", "config/scenes", ".yaml");
  out.rate = reader.number("rate", out.rate, {1.0, 1000.0});
  out.draw_rate = reader.number("draw_rate", out.draw_rate, {0.1, 100.0});
  out.frame_prefix = reader.frame("frame_prefix", "");
  out.handle = reader.flag("handle", out.handle);
  out.scene_folder = reader.folder("scene_folder", defaultFolder());
  reader.finish();
  return out;
}

}  // namespace helix_arm::ros_bridge
