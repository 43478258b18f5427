#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <deque>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include <diagnostic_msgs/DiagnosticStatus.h>
#include <ros/node_handle.h>
#include <ros/time.h>
#include <tf2_ros/static_transform_broadcaster.h>
#include <visualization_msgs/MarkerArray.h>

#include "helix_arm/control/safety.hpp"
#include "helix_arm/io/scene.hpp"
#include "helix_arm/model/arm_response.hpp"
#include "helix_arm/model/curve.hpp"
#include "helix_arm/regulator/realtime.hpp"
#include "ros_bridge/common/arm_frames.hpp"
#include "ros_bridge/common/diagnostics.hpp"
#include "ros_bridge/common/marker_parts.hpp"
#include "tip_handle.hpp"

namespace helix_arm::ros_bridge {

/// Private parameters of pressure_command.
struct PressureCommandOptions {
  std::string scene;  ///< ~scene: path, or the name of a shipped scene; required
  /// ~scene_folder: folder from which ~reload accepts scenes, besides those of the package and
  /// ~scene; default: `helix_arm` below ROS_HOME.
  std::string scene_folder;
  double rate = 100.0;      ///< ~rate: of the loop, 1 to 1000 [Hz]
  double tf_rate = 100.0;   ///< ~tf_rate: of the moving frames, at most the loop's [Hz]
  double draw_rate = 20.0;  ///< ~draw_rate: of the markers, 0.1 to 100 [Hz]
  /// ~frames: number of frames on the curve, model_0 .. model_(frames - 1), 2 to 1000.
  int frames = 5;
  std::string world_frame;   ///< ~world_frame: "world"
  std::string frame_prefix;  ///< ~frame_prefix: "", set before arm_base and model_*
  bool handle = true;        ///< ~handle: show the interactive marker
  /// ~regulator: `scene` drives the scene's regulator, hardware or simulated, from this node;
  /// `topic` leaves the pressures to another node, which reports them on pressure_measured.
  std::string regulator = "scene";
  /// ~auto_enable: a target enables the arm, at first and after commander or regulator fell silent.
  /// Default: true with ~regulator `scene`; never with hardware.
  bool auto_enable = true;
  /// ~allow_sim_time: drive hardware although ROS time is simulated; the safety rules run on the
  /// steady clock in any case.
  bool allow_sim_time = false;
  /// ~realtime_priority: of the threads between targets and valves (SCHED_FIFO), and of the guard,
  /// if the user's limits allow it; the log reports the result. 0 to 99, 0: none. With hardware,
  /// memory is locked as well.
  int realtime_priority = regulator::kRealtimePriority;

  /// @throws ParameterError with every fault.
  static PressureCommandOptions load();
};

/// Draws an arm for rviz, seen from its base frame, in stable namespaces and ids.
///
/// - muscles: one tube per actuator, coloured by its pressure: blue at the lower limit, lilac at
/// the
///   upper one
/// - base_curve: the curve that the muscles bend
/// - separators: the discs that hold the muscles
/// - tip_trace: trace of the tip, smoothed over a few drawings
/// - pressures: one line of text per actuator, in kPa and in its muscle's colour, beside the base
/// - state_banner: the state of the arm (0), after its name if its frames have a prefix, and its
///   reason (1), in the state's colour
/// - legend: what is drawn here, one line each in its curve's colour
class ArmMarkers {
 public:
  /// Keeps a reference to the scene.
  ///
  /// @param lifetime  longer than the period of drawing [s].
  ArmMarkers(const io::Scene& scene, std::string base_frame, double lifetime)
      : scene_(scene), marker_{std::move(base_frame), ros::Duration(lifetime)} {}

  /// The text above the base, with the next drawing.
  void tell(const control::SafetyReport& report, const std::string& reason) {
    safety_ = report;
    reason_ = reason;
  }

  /// @param shape     to draw.
  /// @param pressure  (n) pressures for the colours and the text, gauge [Pa].
  /// @param stamp     stamp of the shape; one before the last stamp (a jump back in time) starts a
  /// new trace.
  visualization_msgs::MarkerArray draw(const model::Shape& shape, const model::InputRef& pressure,
                                       const ros::Time& stamp);

  /// Removes all markers; the next drawing starts a new trace.
  visualization_msgs::MarkerArray remove(const ros::Time& stamp);

 private:
  using Curve = std::vector<model::CurvePoint<lie::SE3>>;

  void addMuscles(const Curve& curve, const lie::SE3& X_end, int section,
                  const model::InputRef& pressure, const SideView& view,
                  visualization_msgs::MarkerArray& out) const;
  /// @param disc  id of the next disc.
  void addDiscs(const model::Shape& shape, const lie::SE3& X_end, int section, int& disc,
                visualization_msgs::MarkerArray& out) const;
  void extendTrace(const Eigen::Vector3d& tip);
  void addWords(const SideView& view, visualization_msgs::MarkerArray& out) const;

  const io::Scene& scene_;
  const MarkerFrame marker_;
  ros::Time stamp_;
  control::SafetyReport safety_;
  std::string reason_;
  std::vector<std::pair<std::string, int>> drawn_;  ///< namespaces and ids on the screen
  Eigen::Vector3d smooth_tip_;                      ///< base frame [m]
  std::deque<Eigen::Vector3d> trace_;               ///< base frame [m]
};

/// From measured pressures to the arm's shape: lets the responses of its actuators follow them,
/// solves the model and publishes model, markers, tf and the tip handle. What the responses
/// remember outlasts vents, stops and changes of the scene; time that goes back, as when a
/// recording starts over, ends it.
///
/// Nothing is published where the model finds no shape, and the markers are removed when readings
/// stop; the statuses say so. All of it belongs to the thread of the node's callback queue.
class ShapePublisher {
 public:
  /// @param scene      Kept by reference: after a change to it, call adopt() before the next
  ///                   reading.
  /// @param on_target  As TipHandle's.
  ShapePublisher(ros::NodeHandle node, const io::Scene& scene,
                 const PressureCommandOptions& options, TipHandle::OnTarget on_target);

  /// Follows a change of the scene: frames, and the shape at the last reading.
  void adopt() {
    sendBaseFrame();
    response_.adopt(scene_.arm);
    solve();
  }

  /// Publishes the shape at a reading.
  /// @param measured  (n) gauge [Pa]
  void take(const Eigen::VectorXd& measured, const ros::Time& stamp);

  /// Brings the handle, if there is one, to the model's tip at these pressures once they are
  /// effective, if it finds one.
  /// @param goal  (n) gauge [Pa]
  void moveHandle(const Eigen::VectorXd& goal) {
    if (!handle_) return;
    const statics::Tip commanded =
        scene_.model.tip(scene_.arm.clamped(response_.effectiveAt(goal)));
    if (commanded.converged()) handle_->follow(commanded.tip);
  }
  /// The state of the arm, drawn above its base from the next drawing on.
  void tell(const control::SafetyReport& report, const std::string& reason) {
    markers_.tell(report, reason);
  }
  /// Draws the shape at the last reading, or removes it if that is stale or has no shape.
  void draw();

  /// What the actuators remember of their measured pressures.
  const model::ArmResponse& response() const { return response_; }

  const std::string& baseFrame() const { return frames_.base; }

  /// The status `<node>: model`: its tier, and whether it finds a shape.
  diagnostic_msgs::DiagnosticStatus status() const;
  /// Sets level and message of a status if there is no fresh reading.
  void reportSilence(diagnostic_msgs::DiagnosticStatus& status) const;

 private:
  void solve();           ///< the shape at the effective pressures
  bool measures() const;  ///< the last reading is fresh
  std::string unmeasuredText() const {
    return own_regulator_ ? "the regulator has given no readings (see its diagnostics)"
                          : "no pressure_measured is received; is the regulator's node running?";
  }
  void sendBaseFrame() {
    static_tf_.sendTransform(worldTransform(frames_.world, frames_.base, scene_.X_WB));
  }

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

  ros::Publisher model_publisher_, marker_publisher_;
  CurveFrames curve_frames_{frames_, "pressure_measured is", "it"};
  tf2_ros::StaticTransformBroadcaster static_tf_;
  std::unique_ptr<TipHandle> handle_;
};

}  // namespace helix_arm::ros_bridge
