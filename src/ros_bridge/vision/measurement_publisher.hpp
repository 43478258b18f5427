#pragma once

#include <string>

#include <ros/node_handle.h>
#include <ros/time.h>
#include <tf2_ros/transform_broadcaster.h>

#include "observations.hpp"
#include "ros_bridge/common/arm_frames.hpp"
#include "ros_bridge/common/diagnostics.hpp"
#include "vision_options.hpp"
#include "vision_status_publisher.hpp"

namespace helix_arm::ros_bridge {

/// Publishes what was measured in each picture: state, measured, model_error, tf, tag_detections,
/// and at a limited rate overlay and markers. With VisionOptions::publish_image also the picture
/// itself and its camera_info, while someone subscribes to them. For one thread.
class MeasurementPublisher {
 public:
  /// @param frames  of the measured shape.
  /// @param status  outlives this.
  MeasurementPublisher(ros::NodeHandle& node, const VisionOptions& options, FrameNames frames,
                       VisionStatusPublisher& status);

  void publish(const Measurement& measurement);

 private:
  void republish(const Measurement& measurement);
  void sendFrames(const Measurement& measurement);
  void draw(const Measurement& measurement, const ObservationReport& report);

  const FrameNames frames_;
  const std::string camera_frame_;
  const ros::WallDuration drawing_period_;
  VisionStatusPublisher& status_;

  ros::Time last_stamp_;     // of the last measured picture
  ros::Time last_tf_stamp_;  // of the last frames sent since time jumped back
  ros::SteadyTime last_drawing_;
  FaultCount far_stamps_;
  ros::Publisher measured_publisher_, detections_publisher_, error_publisher_, overlay_publisher_;
  ros::Publisher image_publisher_, info_publisher_;  // only with VisionOptions::publish_image
  tf2_ros::TransformBroadcaster tf_;
};

}  // namespace helix_arm::ros_bridge
