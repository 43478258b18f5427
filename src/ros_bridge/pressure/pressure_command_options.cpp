#include "pressure_command_options.hpp"

#include <algorithm>

#include "ros_bridge/common/file_access.hpp"
#include "ros_bridge/names.hpp"
#include "ros_bridge/common/parameters.hpp"

namespace helix_arm::ros_bridge {

PressureCommandOptions PressureCommandOptions::load() {
  ParameterReader reader{ros::NodeHandle("~")};
  PressureCommandOptions out;
  out.scene = reader.file("scene", "config/scenes", ".yaml");
  out.rate = reader.number("rate", out.rate, {1.0, 1000.0});
  out.tf_rate = std::min(out.rate, reader.number("tf_rate", out.tf_rate, {0.1, 1000.0}));
  out.draw_rate = reader.number("draw_rate", out.draw_rate, {0.1, 100.0});
  out.frames = reader.count("frames", out.frames, 2, 1000);
  out.world_frame = reader.frame("world_frame", names::kWorldFrame);
  out.frame_prefix = reader.frame("frame_prefix", "");
  out.handle = reader.flag("handle", out.handle);
  out.regulator = reader.choice("regulator", out.regulator, {"scene", "topic"});
  out.auto_enable = reader.flag("auto_enable", out.regulator == "scene");
  out.allow_sim_time = reader.flag("allow_sim_time", out.allow_sim_time);
  out.realtime_priority = reader.count("realtime_priority", out.realtime_priority, 0,
                                       regulator::kHighestRealtimePriority);
  out.scene_folder = reader.folder("scene_folder", defaultFolder());
  reader.finish();
  return out;
}

}  // namespace helix_arm::ros_bridge
