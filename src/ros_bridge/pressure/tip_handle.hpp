#pragma once

#include <functional>
#include <string>

#include <interactive_markers/interactive_marker_server.h>
#include <ros/time.h>

#include "helix_arm/TipTarget.h"
#include "helix_arm/io/scene.hpp"
#include "helix_arm/lie/se3.hpp"
#include "ros_bridge/common/guarded_callbacks.hpp"

namespace helix_arm::ros_bridge {

/// A handle in rviz that drags the tip: an interactive marker that sends position targets,
/// orientation free.
class TipHandle {
 public:
  using OnTarget = std::function<void(const TipTarget&)>;

  /// @param scene      of the arm: tip and handle of a planar one stay in the base's x-y plane.
  /// @param on_target  called from the callback queue while the handle is held, with a target in
  /// the base frame.
  TipHandle(const std::string& base_frame, const io::Scene& scene, OnTarget on_target);

  /// Moves the handle to the commanded tip (base frame), unless it is held.
  void follow(const lie::SE3& X_BT);

 private:
  void onFeedback(const visualization_msgs::InteractiveMarkerFeedbackConstPtr& feedback);
  bool held() const;

  FaultGuard guard_{"a feedback of the tip's handle"};
  OnTarget on_target_;
  interactive_markers::InteractiveMarkerServer server_;
  Eigen::Vector3d position_ = Eigen::Vector3d::Constant(1e9);  ///< of the handle, base frame [m]
  bool pressed_ = false;
  ros::SteadyTime last_feedback_;
};

}  // namespace helix_arm::ros_bridge
