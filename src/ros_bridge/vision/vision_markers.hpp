#pragma once

#include <string>

#include <visualization_msgs/MarkerArray.h>

#include "ros_bridge/common/side_view.hpp"
#include "ros_bridge/vision/measurement.hpp"

namespace helix_arm::ros_bridge {

/// Draws for rviz what is measured, seen from the arm's base frame, in stable namespaces and ids.
///
/// - measured_curve: solid
/// - model_curve: dashed
/// - tags: outlines of those that the shape was fitted to, red where they do not fit
/// - tip_error: what the tip's distance from the model is, as text beyond the tip
/// - legend: what the curves are, one line each in its curve's colour
/// - tip_covariance: where the tip is within two standard deviations, an ellipsoid
class VisionMarkers {
 public:
  /// @param lifetime  longer than the period of drawing [s].
  VisionMarkers(std::string base_frame, double lifetime);

  /// Of the arm whose texts are drawn from now on, in the axes of its base.
  void lookAt(const SideView& view) { view_ = view; }

  /// @param measurement  has a measured shape; without a model none is drawn.
  /// @param text         beyond the tip.
  visualization_msgs::MarkerArray draw(const Measurement& measurement,
                                       const std::string& text) const;

  /// Takes everything off the screen.
  visualization_msgs::MarkerArray remove(const ros::Time& stamp) const;

 private:
  visualization_msgs::Marker marker(const ros::Time& stamp, const char* ns, int type) const;

  SideView view_ = sideView(Eigen::Vector3d::UnitX(), 0.3, 0.03);
  std::string base_frame_;
  ros::Duration lifetime_;
};

}  // namespace helix_arm::ros_bridge
