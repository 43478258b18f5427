#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <utility>

#include <diagnostic_msgs/DiagnosticStatus.h>
#include <ros/node_handle.h>
#include <ros/time.h>
#include <sensor_msgs/JointState.h>
#include <tf2_ros/static_transform_broadcaster.h>

#include "helix_arm/ArmShape.h"
#include "helix_arm/control/safety.hpp"
#include "helix_arm/io/scene.hpp"
#include "helix_arm/model/arm_response.hpp"
#include "helix_arm/statics/arm_model.hpp"
#include "regulator/realtime.hpp"
#include "ros_bridge/common/arm_frames.hpp"
#include "ros_bridge/common/arm_markers.hpp"
#include "ros_bridge/common/diagnostics.hpp"
#include "ros_bridge/common/parameters.hpp"
#include "target_admission.hpp"

namespace helix_arm::ros_bridge {

/// Private parameters of pressure_command.
struct PressureCommandOptions {
  ParameterReader reader{ros::NodeHandle("~")};
  std::string scene = reader.file("scene", "config/scenes", ".yaml");
  double rate = reader.number("rate", 100.0, {1.0, 1000.0});  ///< of the loop [Hz]
  /// Rate of the moving frames, at most the loop's [Hz].
  double tf_rate = std::min(rate, reader.number("tf_rate", 100.0, {0.1, 1000.0}));
  double draw_rate = reader.number("draw_rate", 20.0, {0.1, 100.0});  ///< of the markers [Hz]
  int frames = reader.count("frames", 5, 2, 1000);  ///< on the curve: model_0 .. model_(frames - 1)
  std::string world_frame = reader.frame("world_frame", names::kWorldFrame);
  std::string frame_prefix = reader.frame("frame_prefix", "");  ///< of arm_base and model_*
  bool handle = reader.flag("handle", true);                    ///< show the interactive marker
  /// `scene` drives the scene's regulator, hardware or simulated, from this node; `topic` leaves
  /// the pressures to another node, which reports them on pressure_measured.
  std::string regulator = reader.choice("regulator", "scene", {"scene", "topic"});
  /// A target enables the arm, first and after commander or regulator fell silent; never hardware.
  bool auto_enable = reader.flag("auto_enable", regulator == "scene");
  /// Drive hardware although ROS time is simulated; the safety rules run on the steady clock.
  bool allow_sim_time = reader.flag("allow_sim_time", false);
  /// Priority (SCHED_FIFO) of the threads between targets and valves, and of the guard, if the
  /// user's limits allow it; the log reports the result. 0: none. With hardware, memory is locked
  /// as well.
  int realtime_priority = reader.count("realtime_priority", regulator::kRealtimePriority, 0,
                                       regulator::kHighestRealtimePriority);
  /// Folder from which ~reload accepts scenes, besides those of the package and ~scene.
  std::string scene_folder = reader.folder("scene_folder", defaultFolder());

  PressureCommandOptions() { reader.finish(); }
};

/// From measured pressures to the arm's shape: lets the responses of its actuators follow them,
/// solves the model and publishes model, markers, tf and the tip handle. What the responses
/// remember outlasts vents, stops and changes of the scene, not time that goes back.
///
/// Nothing is published where the model finds no shape, and the markers are removed when readings
/// stop; the statuses say so. All of it belongs to the thread of the node's callback queue.
class ShapePublisher {
 public:
  using DiagnosticStatus = diagnostic_msgs::DiagnosticStatus;

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
  DiagnosticStatus status() const;

  /// Sets level and message of a status if there is no fresh reading.
  void reportSilence(DiagnosticStatus& status) const;

 private:
  static constexpr double kFresh = 1.0;  ///< a longer silence of the regulator is an error [s]

  /// The shape at the effective pressures.
  void solve();

  /// The arm in the words of other programs. Of each actuator: position is the measured pressure
  /// [Pa], effort the command [Pa]. Of each section, `NAME_bend_y`, `NAME_bend_z` and `NAME_twist`:
  /// angles about y, z and x of its base curve [rad], whose effort is NaN.
  void publishJoints(const std_msgs::Header& header, const Eigen::VectorXd& command) const;

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
