#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <string>

#include <geometry_msgs/PoseStamped.h>
#include <ros/node_handle.h>
#include <ros/steady_timer.h>
#include <ros/time.h>
#include <tf2_ros/static_transform_broadcaster.h>

#include "helix_arm/ArmShape.h"
#include "helix_arm/ModelError.h"
#include "helix_arm/TagDetections.h"
#include "helix_arm/io/scene.hpp"
#include "observations.hpp"
#include "picture_measurer.hpp"
#include "picture_source.hpp"
#include "ros_bridge/common/arm_frames.hpp"
#include "ros_bridge/common/diagnostics.hpp"
#include "ros_bridge/common/parameters.hpp"
#include "ros_bridge/common/run_node.hpp"
#include "ros_bridge/names.hpp"

namespace helix_arm::ros_bridge {

/// Measures the shape of a scene's arm from pictures of its tags, and compares the model with it:
/// the node vision of docs/nodes.md. Parameters: VisionOptions.
///
/// A bad picture or camera_info is counted, warned of at a limited rate and reported on
/// vision_status, not measured. A steady clock tells whether pictures come; all else is by stamps.
class VisionNode : public Node {
 public:
  /// Whose process it lives in: a fault in its threads ends its own, but not a nodelet manager's.
  enum class Host { kOwnProcess, kManager };

  /// @param node          where topics are relative to.
  /// @param private_node  where parameters are; names the node in diagnostics.
  /// @throws io::DocumentError or std::invalid_argument with every fault found; NothingToDo.
  VisionNode(const ros::NodeHandle& node, const ros::NodeHandle& private_node, Host host);

  ~VisionNode() override { end(); }

  int finish() override;

 private:
  /// Subscribes. A shape of another arm is counted; the picture is measured without it.
  ros::Subscriber hear(const char* topic, std::uint32_t queue, const char* what,
                       void (PictureMeasurer::*add)(const ros::Time&, const model::Shape&));
  void adopt(io::Scene next);
  void sendCameraFrame();

  // In the thread that failed.
  void onFailure();

  // Thread of the measurements.
  void work();
  void measure(const Picture& picture);
  void publish(const Measurement& measurement);

  /// From any thread: ends the threads, and all waits.
  void stop();

  /// Stops, and waits for the threads to end.
  void end();

  const Host host_;
  const VisionOptions options_;
  const std::string name_;  ///< of the node
  const FrameNames frames_;

  // Used by callbacks only.
  io::Scene scene_;  ///< the last one loaded
  ros::NodeHandle node_;
  const LoopWatch watched_{node_};
  tf2_ros::StaticTransformBroadcaster static_tf_;

  // A picture passes from source_ through measurer_ to publish().
  VisionStatusPublisher status_;  ///< from any thread
  PictureSource source_;          ///< locks what its threads share
  PictureMeasurer measurer_;      ///< locks what its threads share

  // Used by the thread of the measurements only.
  const ros::Publisher measured_publisher_ = node_.advertise<ArmShape>(names::kMeasured, 10),
                       tip_publisher_ =
                           node_.advertise<geometry_msgs::PoseStamped>(names::kTip, 10),
                       detections_publisher_ =
                           node_.advertise<TagDetections>(names::kTagDetections, 10),
                       error_publisher_ = node_.advertise<ModelError>(names::kModelError, 10),
                       overlay_publisher_ = node_.advertise<sensor_msgs::Image>(names::kOverlay, 1);
  ros::Publisher image_publisher_, info_publisher_;  ///< only with VisionOptions::publish_image
  ros::Publisher bodies_publisher_;                  ///< only with VisionOptions::fromBodies()
  CurveFrames curve_frames_{frames_, "pictures are", "them"};
  ros::SteadyTime last_drawing_;
  FaultGuard picture_guard_{"a picture"};

  ros::Subscriber model_subscriber_, estimate_subscriber_;
  std::unique_ptr<ReloadServer> reload_;
  ros::SteadyTimer watch_timer_, second_timer_;
  GuardedThread worker_;  ///< the thread of the measurements
};

}  // namespace helix_arm::ros_bridge
