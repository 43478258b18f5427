#pragma once

#include <functional>
#include <string>

#include <ros/node_handle.h>

#include "helix_arm/ArmShape.h"
#include "helix_arm/TagDetections.h"
#include "helix_arm/io/scene.hpp"
#include "ros_bridge/follow/loop_diagnostics.hpp"
#include "ros_bridge/follow/tag_matcher.hpp"

namespace helix_arm::ros_bridge {

/// Takes the measured shapes with the tags of their fits.
///
/// Subscribes to measured and tag_detections. For the thread of the node's callback queue.
class ObservationIntake {
 public:
  using OnSeen = std::function<void(const SeenArm& seen)>;

  /// @param scene     Kept by reference: after a change to it, call adopt().
  /// @param pictures  gets the shapes that are not of this arm. Outlives this.
  /// @param on_seen   called with each shape, in the order of the messages.
  ObservationIntake(ros::NodeHandle& node, const io::Scene& scene, std::string base_frame,
                    LoopDiagnostics& pictures, OnSeen on_seen);

  /// Gives up the wait for tags that do not come. To be called regularly.
  void poll();
  /// Follows a change of the scene.
  void adopt() { matcher_.clear(); }

 private:
  void onMeasured(const ArmShapeConstPtr& shape);
  void onTags(const TagDetectionsConstPtr& detections);

  const io::Scene& scene_;
  const std::string base_frame_;
  LoopDiagnostics& pictures_;
  const OnSeen on_seen_;
  TagMatcher matcher_;
  ros::Subscriber measured_subscriber_, tags_subscriber_;
};

}  // namespace helix_arm::ros_bridge
