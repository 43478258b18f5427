#include "vision_options.hpp"

#include <algorithm>
#include <system_error>

#include "helix_arm/io/shipped_files.hpp"
#include "ros_bridge/common/file_access.hpp"
#include "ros_bridge/common/parameters.hpp"
#include "ros_bridge/names.hpp"

namespace helix_arm::ros_bridge {
namespace {

constexpr char kTopic[] = "topic";
constexpr char kWebcam[] = "webcam";

}  // namespace

VisionOptions VisionOptions::load(const ros::NodeHandle& private_node) {
  ParameterReader reader(private_node);
  VisionOptions out;
  out.scene = reader.file("scene", "config/scenes", ".yaml");
  out.source = reader.text("source", out.source);
  std::vector<std::string> words = {kTopic, names::kImage, names::kCompressedImage, kWebcam};
  // Words come first: image/compressed has a slash, and would count as a path.
  const bool is_word = std::find(words.begin(), words.end(), out.source) != words.end();
  std::error_code fault;  // counts as not there
  if (!is_word && !out.source.empty() &&
      (io::isPath(out.source) || std::filesystem::exists(callersFolder() / out.source, fault))) {
    out.source = reader.absolute("source", out.source);
  } else {
    words.emplace_back("a path (with a / or a ., or of what is there)");
    out.source = reader.choice("source", out.source, words);
  }
  out.use_camera_info = reader.flag("use_camera_info", out.use_camera_info);
  out.camera_info_url = reader.text("camera_info_url", "");
  out.file_rate = reader.number("file_rate", out.file_rate, {0.1, 1000.0});
  out.draw_rate = reader.number("draw_rate", out.draw_rate, {0.1, 100.0});
  out.stale_after = reader.number("stale_after_s", out.stale_after, {0.05, 60.0});
  out.publish_image = reader.flag("publish_image", out.publish_image);
  out.frames = reader.count("frames", out.frames, 2, 1000);
  out.world_frame = reader.frame("world_frame", names::kWorldFrame);
  out.frame_prefix = reader.frame("frame_prefix", "");
  out.optional = reader.flag("optional", out.optional);
  out.scene_folder = reader.folder("scene_folder", defaultFolder());
  reader.finish();
  return out;
}

bool VisionOptions::fromWebcam() const { return source == kWebcam; }

bool VisionOptions::fromFile() const { return source.compare(0, 1, "/") == 0; }

bool VisionOptions::fromTopic(const std::string& topic) const {
  return source == kTopic || source == topic;
}

std::string VisionOptions::cameraFrame() const { return frame_prefix + names::kCameraFrame; }

}  // namespace helix_arm::ros_bridge
