#pragma once

#include <cstdint>
#include <memory>
#include <string>

#include <diagnostic_msgs/DiagnosticStatus.h>
#include <ros/node_handle.h>
#include <ros/time.h>
#include <tf2_ros/static_transform_broadcaster.h>

#include "helix_arm/control/safety.hpp"
#include "helix_arm/io/scene.hpp"
#include "helix_arm/model/arm_response.hpp"
#include "helix_arm/statics/arm_model.hpp"
#include "pressure_command_options.hpp"
#include "ros_bridge/common/arm_frames.hpp"
#include "ros_bridge/common/arm_markers.hpp"
#include "ros_bridge/common/diagnostics.hpp"

namespace helix_arm::ros_bridge {

/// From measured pressures to the arm's shape: lets the responses of its actuators follow them,
/// solves the model and publishes model, markers, tf and the tip handle. What the responses
/// remember outlasts vents, stops and changes of the scene, not time that goes back.
///
/// Nothing is published where the model finds no shape, and the markers are removed when readings
/// stop; the statuses say so. All of it belongs to the thread of the node's callback queue.
class ShapePublisher {
 public:
  /// @param scene      Kept by reference: after a change, call adopt() before the next reading.
  /// @param on_target  As TipHandle's.
  ShapePublisher(ros::NodeHandle node, const io::Scene& scene,
                 const PressureCommandOptions& options, TipHandle::OnTarget on_target);

  /// Follows a change of the scene: frames, and the shape at the last reading.
  void adopt();

  /// Publishes the shape at a reading.
  /// @param measured, command  (n) gauge [Pa]
  void take(const Eigen::VectorXd& measured, const Eigen::VectorXd& command,
            const ros::Time& stamp);

  /// Brings the handle, if any, to the model's tip, if any, once these pressures are effective.
  /// @param goal  (n) gauge [Pa]
  void moveHandle(const Eigen::VectorXd& goal);
  /// Draws the shape at the last reading, with the state of the arm above its base, or removes it
  /// if that reading is stale or has no shape.
  void draw(const control::SafetyReport& report, const std::string& reason);

  /// Responses of the actuators to the pressures measured so far.
  const model::ArmResponse& response() const { return response_; }

  /// The shape that is on the screen; null if there is none.
  const model::Shape* drawn() const { return drawn_ ? &solution_.shape : nullptr; }

  const std::string& baseFrame() const { return frames_.base; }

  /// The status `<node>: model`: its tier, and whether it finds a shape.
  diagnostic_msgs::DiagnosticStatus status() const;

  /// Sets level and message of a status if there is no fresh reading.
  void reportSilence(diagnostic_msgs::DiagnosticStatus& status) const;

 private:
  /// The shape at the effective pressures.
  void solve();

  /// Whether the last reading is fresh.
  bool measures() const;
  std::string unmeasuredText() const;
  void sendBaseFrame();

  const io::Scene& scene_;
  const FrameNames frames_;
  const std::uint64_t readings_per_tf_;
  const bool own_regulator_;
  ArmMarkers markers_;

  Eigen::VectorXd measured_;  ///< last reading [Pa]
  model::ArmResponse response_;
  statics::Solution solution_;    ///< at the effective pressures, clamped
  ros::SteadyTime last_reading_;  ///< zero: none yet
  std::uint64_t readings_ = 0;
  FaultCount unsolved_;  ///< readings at which the model finds no shape
  FaultCount losses_;    ///< of pressure_measured
  FaultCount restarts_;  ///< of the responses
  bool drawn_ = false;   ///< the arm is on the screen

  ros::Publisher model_publisher_, tip_publisher_, joints_publisher_, marker_publisher_;
  CurveFrames curve_frames_{frames_, "pressure_measured is", "it"};
  tf2_ros::StaticTransformBroadcaster static_tf_;
  std::unique_ptr<TipHandle> handle_;
};

}  // namespace helix_arm::ros_bridge
