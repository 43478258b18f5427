#pragma once

#include <Eigen/Core>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include <ros/node_handle.h>
#include <ros/time.h>
#include <visualization_msgs/MarkerArray.h>

#include "helix_arm/LoopStatus.h"
#include "helix_arm/follow/visual_servo.hpp"
#include "helix_arm/io/scene.hpp"
#include "loop_diagnostics.hpp"
#include "ros_bridge/common/marker_parts.hpp"
#include "ros_bridge/pressure/tip_handle.hpp"

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
  LoopMarkers(std::string base_frame, double lifetime)
      : marker_{std::move(base_frame), ros::Duration(lifetime)} {}

  /// @param view  in the axes of the base.
  visualization_msgs::MarkerArray draw(const ros::Time& stamp, const SideView& view,
                                       const Tips& tips) const;

 private:
  visualization_msgs::Marker ball(const ros::Time& stamp, const char* ns,
                                  const std::optional<Eigen::Vector3d>& centre, double size) const;
  visualization_msgs::Marker curve(const ros::Time& stamp, const Tips& tips) const;
  visualization_msgs::Marker words(const ros::Time& stamp, const char* ns,
                                   const std::optional<Eigen::Vector3d>& place, double height,
                                   const std::string& text) const;
  void addLegend(const ros::Time& stamp, const SideView& view, LegendLine line, bool drawn,
                 visualization_msgs::MarkerArray& out) const;
  visualization_msgs::Marker arrow(const ros::Time& stamp, const Tips& tips) const;

  const MarkerFrame marker_;
};

/// Publishes loop_status, estimate and loop_markers, and holds the tip handle at the wanted tip.
/// For the thread of the node's callback queue.
class LoopPublisher {
 public:
  /// The loop after a turn.
  struct View {
    ros::Time stamp;  ///< of the turn
    const follow::VisualServo& loop;
    std::optional<ros::Time> last_picture;  ///< that the loop used
    std::string commander;                  ///< empty if nobody commands
    std::string message;                    ///< why it is in its state
    const LoopDiagnostics& pictures;
  };

  /// @param scene      Kept by reference.
  /// @param rate       Maximum of status and estimate [Hz].
  /// @param draw_rate  Of draw() [Hz].
  /// @param on_target  As TipHandle's; empty: no handle.
  LoopPublisher(ros::NodeHandle& node, const io::Scene& scene, std::string base_frame, double rate,
                double draw_rate, TipHandle::OnTarget on_target);

  /// Publishes status and estimate: at a change of state, else at this rate.
  void publish(const View& view);
  /// Draws what was published last.
  void draw();
  /// Nothing is measured any more: the next drawing removes all.
  void clear();
  /// Covariance of the predicted tip's position, base frame [m^2].
  static Eigen::Matrix3d tipCovariance(const View& view);

 private:
  bool isDue(const View& view) const;
  LoopStatus statusOf(const View& view, const Eigen::Matrix3d& tip_covariance) const;
  void publishEstimate(const View& view);
  void noteBudget(const View& view);

  const io::Scene& scene_;
  const std::string base_frame_;
  const double period_;  ///< of the status [s]
  LoopMarkers markers_;
  LoopStatus status_;                     ///< the last one
  std::optional<Eigen::Vector3d> force_;  ///< on the arm, while something touches it [N]
  std::vector<Eigen::Vector3d> curve_;    ///< of the corrected model, base frame [m]
  std::string force_text_;
  std::string budget_text_;  ///< empty: nothing was seen for a while
  bool outside_ = false;     ///< of the budget
  ros::Publisher status_publisher_, estimate_publisher_, marker_publisher_;
  std::unique_ptr<TipHandle> handle_;
};

/// Publishes what the pictures tell of the arm besides its shape: error_budget and external_load.
class LoadPublisher {
 public:
  LoadPublisher(ros::NodeHandle& node, std::string base_frame);

  /// After a picture that the loop used, or a change of the loop itself such as a reset. A budget
  /// of this picture is published at most at 5 Hz; the load on every change, and with every picture
  /// while something touches the arm.
  void publish(const ros::Time& picture, const follow::VisualServo& loop);
  /// After a turn: the load, if its state has changed without a picture, as by a lack of pictures.
  void publishChange(const ros::Time& turn, const follow::VisualServo& loop);

 private:
  void publishBudget(const ros::Time& picture, const estimation::TipErrorBudget& budget,
                     const estimation::Drift& drift);
  void publishLoad(const ros::Time& stamp, const follow::VisualServo& loop);

  const std::string base_frame_;
  ros::Publisher budget_publisher_, load_publisher_;
  ros::Time last_budget_;
  std::string last_state_;  ///< of the load
};

}  // namespace helix_arm::ros_bridge
