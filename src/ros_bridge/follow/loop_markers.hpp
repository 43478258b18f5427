#pragma once

#include <optional>
#include <string>
#include <vector>

#include <visualization_msgs/MarkerArray.h>

#include "ros_bridge/common/side_view.hpp"

namespace helix_arm::ros_bridge {

/// Draws for rviz what a loop over vision wants and predicts, seen from the arm's base frame, in
/// stable namespaces and ids.
///
/// - wanted_tip: a ball at the wanted tip
/// - predicted_tip: a ball at the tip of the corrected model
/// - predicted_covariance: where that tip is within two standard deviations, an ellipsoid
/// - tip_force: an arrow to the predicted tip along the force that touches the arm
/// - loop_state: the loop's state and error, as text below the predicted tip
/// - legend: what is drawn here, one line each in its colour
/// - error_budget: standard deviations of the tip by their sources, as a table beside the ellipsoid
class LoopMarkers {
 public:
  /// The tips at one time, base frame. What is absent is removed from the screen.
  struct Tips {
    std::optional<Eigen::Vector3d> wanted;     ///< [m]
    std::optional<Eigen::Vector3d> predicted;  ///< [m]
    Eigen::Matrix3d covariance;                ///< of predicted [m^2]
    std::optional<Eigen::Vector3d> force;      ///< on the arm, while something touches it [N]
    std::vector<Eigen::Vector3d> curve;        ///< of the corrected model; empty if unknown
    std::string text;
    std::string budget;    ///< the table; empty: none
    bool outside = false;  ///< the budget does not explain what is measured
  };

  /// @param lifetime  longer than the period of drawing [s].
  LoopMarkers(std::string base_frame, double lifetime);

  /// @param view  in the axes of the base.
  visualization_msgs::MarkerArray draw(const ros::Time& stamp, const SideView& view,
                                       const Tips& tips) const;

 private:
  visualization_msgs::Marker marker(const ros::Time& stamp, const char* ns, int type) const;
  visualization_msgs::Marker ball(const ros::Time& stamp, const char* ns,
                                  const std::optional<Eigen::Vector3d>& centre, double size) const;
  visualization_msgs::Marker curve(const ros::Time& stamp, const Tips& tips) const;
  visualization_msgs::Marker words(const ros::Time& stamp, const char* ns,
                                   const std::optional<Eigen::Vector3d>& place, double height,
                                   const std::string& text) const;
  void addLegend(const ros::Time& stamp, const SideView& view, LegendLine line, bool drawn,
                 visualization_msgs::MarkerArray& out) const;
  visualization_msgs::Marker arrow(const ros::Time& stamp, const Tips& tips) const;

  std::string base_frame_;
  ros::Duration lifetime_;
};

}  // namespace helix_arm::ros_bridge
