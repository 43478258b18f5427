#pragma once

#include <string>

#include <rosbag/bag.h>

#include "helix_arm/PressureArray.h"
#include "helix_arm/TagDetections.h"
#include "helix_arm/io/scene.hpp"

namespace helix_arm::test {

inline io::Scene demo() { return io::loadScene(HELIX_ARM_SOURCE_DIR "/config/scenes/demo.yaml"); }

/// A recording of an arm that is at once where it is commanded to: pressures at 50 Hz, pictures at
/// 10 Hz, written a picture's time after they were taken.
class Recording {
 public:
  explicit Recording(const std::string& path) : path_(path), bag_(path, rosbag::bagmode::Write) {}

  void play(const Eigen::Vector3d& pressure, double seconds, bool commanded = true,
            const std::string& ns = "") {
    for (int k = 0; k < static_cast<int>(50 * seconds); ++k) {
      time_ += ros::Duration(0.02);
      std_msgs::Header header;
      header.stamp = time_;
      PressureArray message;
      message.header = header;
      for (int i = 0; i < pressure.size(); ++i) {
        message.name.push_back(scene_.arm.actuator(i).name);
        message.pressure.push_back(pressure[i]);
      }
      write(ns + "/pressure_measured", message, 0);
      if (commanded) write(ns + "/pressure_command", message, 0);
      if (++tick_ % 5 == 0) write(ns + "/tag_detections", detections(header, pressure), 0.1);
    }
  }

  // The corners of two tags of the scene, one that is not, and one that is seen twice.
  static TagDetections detections(const std_msgs::Header& header, const Eigen::Vector3d& pressure) {
    TagDetections out;
    out.header = header;
    for (const int id : {3, 8, 12, 400}) {
      TagDetection tag;
      tag.id = id;
      tag.known = id != 400;
      tag.repeated = id == 12;
      for (int c = 0; c < 8; ++c) tag.corners[c] = 100 + c + id + 1e-3 * pressure[0];
      out.tags.push_back(tag);
    }
    return out;
  }

  template <class Message>
  void write(const std::string& topic, const Message& message, double late) {
    bag_.write(topic, time_ + ros::Duration(late), message);
  }
  const std::string& close() {
    bag_.close();
    return path_;
  }

 private:
  const io::Scene scene_ = demo();
  std::string path_;
  rosbag::Bag bag_;
  ros::Time time_{1000, 0};
  int tick_ = 0;
};

}  // namespace helix_arm::test
