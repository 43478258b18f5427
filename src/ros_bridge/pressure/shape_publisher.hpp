#pragma once

#include <algorithm>
#include <cmath>
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
#include "helix_arm/basics/text.hpp"
#include "helix_arm/control/safety.hpp"
#include "helix_arm/io/scene.hpp"
#include "helix_arm/model/arm_response.hpp"
#include "helix_arm/regulator/realtime.hpp"
#include "helix_arm/statics/arm_model.hpp"
#include "ros_bridge/common/arm_frames.hpp"
#include "ros_bridge/common/arm_markers.hpp"
#include "ros_bridge/common/conversions.hpp"
#include "ros_bridge/common/diagnostics.hpp"
#include "ros_bridge/common/parameters.hpp"
#include "ros_bridge/names.hpp"
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
                 const PressureCommandOptions& options, TipHandle::OnTarget on_target)
      : scene_(scene),
        frames_(options.world_frame, options.frame_prefix, names::kModelFrames, options.frames),
        readings_per_tf_(static_cast<std::uint64_t>(std::lround(options.rate / options.tf_rate))),
        own_regulator_(options.regulator == "scene"),
        markers_(scene, frames_.base, 1.0 / options.draw_rate),
        measured_(scene.arm.inputAt(0)),
        response_(scene.arm),
        solution_(scene.model.solve(measured_)),
        model_publisher_(node.advertise<ArmShape>(names::kModel, 10)),
        tip_publisher_(node.advertise<geometry_msgs::PoseStamped>(names::kModelTip, 10)),
        joints_publisher_(node.advertise<sensor_msgs::JointState>(names::kJointStates, 10)),
        marker_publisher_(node.advertise<visualization_msgs::MarkerArray>(names::kMarkers, 2)) {
    sendBaseFrame();
    if (options.handle) {
      handle_ = std::make_unique<TipHandle>(frames_.base, scene, std::move(on_target));
    }
  }

  /// Follows a change of the scene: frames, and the shape at the last reading.
  void adopt() {
    sendBaseFrame();
    response_.adopt(scene_.arm);
    solve();
  }

  /// Publishes the shape at a reading.
  /// @param measured, command  (n) gauge [Pa]
  void take(const Eigen::VectorXd& measured, const Eigen::VectorXd& command,
            const ros::Time& stamp) {
    measured_ = measured;
    const ros::Time at = stamp.isZero() ? ros::Time::now() : stamp;
    if (response_.follow(at.toSec(), measured) && !response_.instant() && restarts_.add()) {
      const double rest = response_.restTime();
      logWarning(
          "pressure_measured is stamped earlier than the reading before (%lu times so far): the "
          "actuators' responses start anew, and their memory is unknown until the pressures have "
          "moved by twice the largest play_kpa%s",
          restarts_.total(),
          (rest > 0 ? basics::format(" and %g s have passed", rest) : "").c_str());
    }
    last_reading_ = ros::SteadyTime::now();
    solve();
    ++readings_;
    if (!solution_.converged()) return;
    const std_msgs::Header header = toHeaderMsg(stamp, frames_.base);
    model_publisher_.publish(toShapeMsg(header, scene_.model.choice(), solution_.shape));
    geometry_msgs::PoseStamped tip;
    tip.header = header;
    tip.pose = toPoseMsg(solution_.tip);
    tip_publisher_.publish(tip);
    if (joints_publisher_.getNumSubscribers() > 0) publishJoints(header, command);
    if (readings_ % readings_per_tf_ == 0) curve_frames_.send(solution_.shape, stamp);
  }

  /// Brings the handle, if any, to the model's tip, if any, once these pressures are effective.
  /// @param goal  (n) gauge [Pa]
  void moveHandle(const Eigen::VectorXd& goal) {
    if (!handle_) return;
    const statics::Tip commanded =
        scene_.model.tip(scene_.arm.clamped(response_.effectiveAt(goal, kTargetAt)));
    if (commanded.converged()) handle_->follow(commanded.tip);
  }
  /// Draws the shape at the last reading, with the state of the arm above its base, or removes it
  /// if that reading is stale or has no shape.
  void draw(const control::SafetyReport& report, const std::string& reason) {
    markers_.tell(report, reason);
    const bool was_drawn = std::exchange(drawn_, measures() && solution_.converged());
    if (drawn_) {
      marker_publisher_.publish(markers_.draw(solution_.shape, measured_, ros::Time::now()));
    } else if (was_drawn) {
      marker_publisher_.publish(markers_.remove(ros::Time::now()));
      if (measures() || !losses_.add()) return;
      logWarning(
          "no pressures were measured for %g s (%lu times so far): %s; the arm is not drawn until "
          "they are",
          kFresh, losses_.total(), unmeasuredText().c_str());
    }
  }

  /// Responses of the actuators to the pressures measured so far.
  const model::ArmResponse& response() const { return response_; }

  /// The shape that is on the screen; null if there is none.
  const model::Shape* drawn() const { return drawn_ ? &solution_.shape : nullptr; }

  const std::string& baseFrame() const { return frames_.base; }

  /// The status `<node>: model`: its tier, and whether it finds a shape.
  DiagnosticStatus status() const {
    const statics::TierChoice& choice = scene_.model.choice();
    const bool solved = solution_.converged();
    DiagnosticStatus out =
        makeStatus(names::kModelStatus, solved ? DiagnosticStatus::OK : DiagnosticStatus::ERROR,
                   solved ? "the model finds the arm's shape"
                          : "the model finds no shape that balances the load: none is published; "
                            "check the scene's load and arm.stiffness.K_eps_n",
                   {{"tier", statics::nameOf(choice.setting.tier)},
                    {"order", std::to_string(choice.setting.order)},
                    {"tier_reason", choice.reason},
                    {"solve_status", statics::nameOf(solution_.status)},
                    {"unsolved", std::to_string(unsolved_.total())}});
    if (response_.instant()) return out;
    addValue(out, "memory_known", response_.known() ? "true" : "false");
    if (response_.restTime() > 0) addValue(out, "rest_time_s", fixed(response_.restTime()));
    addValue(out, "effective_uncertainty_kpa",
             fixed(1e-3 * response_.uncertainty(scene_.arm).maxCoeff()));
    return out;
  }

  /// Sets level and message of a status if there is no fresh reading.
  void reportSilence(DiagnosticStatus& status) const {
    if (measures()) return;
    const bool never = last_reading_.isZero();
    status.level = never ? DiagnosticStatus::WARN : DiagnosticStatus::ERROR;
    status.message = never ? "waits for the first pressure_measured" : unmeasuredText();
  }

 private:
  static constexpr double kFresh = 1.0;  ///< a longer silence of the regulator is an error [s]

  /// The shape at the effective pressures.
  void solve() {
    const bool rests = last_reading_.isZero();  // before the first reading
    const Eigen::VectorXd pressure = scene_.arm.clamped(rests ? measured_ : response_.effective());
    solution_ = scene_.model.solve(pressure);
    if (solution_.converged() || !unsolved_.add()) return;
    const std::string at = basics::messageOf((1e-3 * pressure).transpose());
    logWarning(
        "%s: the %s model finds no shape that balances the load at %s kPa (%s, residual %.2g; %lu "
        "times so far): no model is published there; check the scene's load and "
        "arm.stiffness.K_eps_n",
        scene_.name.c_str(), scene_.model.choice().setting.name().c_str(), at.c_str(),
        statics::nameOf(solution_.status), solution_.residual, unsolved_.total());
  }

  /// The arm in the words of other programs. Of each actuator: position is the measured pressure
  /// [Pa], effort the command [Pa]. Of each section, `NAME_bend_y`, `NAME_bend_z` and `NAME_twist`:
  /// angles about y, z and x of its base curve [rad], whose effort is NaN.
  void publishJoints(const std_msgs::Header& header, const Eigen::VectorXd& command) const {
    sensor_msgs::JointState out;
    out.header = header;
    const auto add = [&out](const std::string& name, double position, double effort) {
      out.name.push_back(name);
      out.position.push_back(position);
      out.effort.push_back(effort);
    };
    const model::Arm& arm = scene_.arm;
    for (int i = 0; i < arm.actuatorCount(); ++i) {
      add(arm.actuator(i).name, measured_[i], command[i]);
    }
    const model::Twists twists = solution_.shape.twists();
    for (int k = 0; k < arm.sectionCount(); ++k) {
      const std::string& name = scene_.looks[static_cast<std::size_t>(k)].name;
      add(name + "_bend_y", twists(4, k), NAN);
      add(name + "_bend_z", twists(5, k), NAN);
      add(name + "_twist", twists(3, k), NAN);
    }
    joints_publisher_.publish(out);
  }

  /// Whether the last reading is fresh.
  bool measures() const {
    return !last_reading_.isZero() &&
           ros::SteadyTime::now() - last_reading_ < ros::WallDuration(kFresh);
  }

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

  ros::Publisher model_publisher_, tip_publisher_, joints_publisher_, marker_publisher_;
  CurveFrames curve_frames_{frames_, "pressure_measured is", "it"};
  tf2_ros::StaticTransformBroadcaster static_tf_;
  std::unique_ptr<TipHandle> handle_;
};

}  // namespace helix_arm::ros_bridge
