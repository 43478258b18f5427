#pragma once

#include <Eigen/Core>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include <ros/node_handle.h>
#include <ros/time.h>

#include "helix_arm/LoopStatus.h"
#include "helix_arm/follow/visual_servo.hpp"
#include "helix_arm/io/scene.hpp"
#include "ros_bridge/follow/loop_diagnostics.hpp"
#include "ros_bridge/follow/loop_markers.hpp"
#include "ros_bridge/follow/visual_servo_options.hpp"
#include "ros_bridge/pressure/tip_handle.hpp"

namespace helix_arm::ros_bridge {

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
  /// @param on_target  As TipHandle's; without ~handle it is not called.
  LoopPublisher(ros::NodeHandle& node, const io::Scene& scene, const VisualServoOptions& options,
                std::string base_frame, TipHandle::OnTarget on_target);

  /// Publishes status and estimate: at a change of state, else at ~rate.
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

}  // namespace helix_arm::ros_bridge
