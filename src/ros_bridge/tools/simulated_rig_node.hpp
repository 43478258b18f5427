#pragma once

#include <memory>
#include <optional>
#include <string>

#include <geometry_msgs/WrenchStamped.h>
#include <ros/node_handle.h>
#include <ros/steady_timer.h>

#include "helix_arm/PressureArray.h"
#include "helix_arm/basics/mutex.hpp"
#include "helix_arm/io/scene.hpp"
#include "helix_arm/model/arm_response.hpp"
#include "helix_arm/vision/jpeg.hpp"
#include "ros_bridge/common/diagnostics.hpp"
#include "ros_bridge/common/run_node.hpp"

namespace helix_arm::ros_bridge {

/// Private parameters of simulated_rig.
struct SimulatedRigOptions {
  std::string scene;  ///< ~scene: as pressure_command's; required
  /// ~regulator: "scene" simulates the scene's; "topic": the arm follows the readings of another
  /// regulator, on pressure_measured
  std::string regulator = "scene";
  double rate = 100.0;        ///< ~rate: of the regulator, 1 to 1000 [Hz]
  double camera_rate = 15.0;  ///< ~camera_rate: of the pictures, 0.1 to 100 [Hz]
  std::string frame_prefix;   ///< ~frame_prefix: "", set before arm_base and camera_optical
  /// ~command_timeout_s: time without commands after which the regulator vents by itself, or
  /// without readings after which their absence is warned of (before the first one, at least 3 s),
  /// 0.01 to 60 [s]
  double command_timeout = 0.5;
  /// ~time_factor: 0 uses the time of the other nodes. Other values make this node their clock
  /// (needs use_sim_time), with this number of simulated seconds per second, 0.01 to 1000; not with
  /// the regulator of another node, whose time is its own.
  double time_factor = 0.0;

  /// @throws ParameterError with every fault.
  static SimulatedRigOptions load();
};

/// Simulates the hardware of a scene: regulator, true arm and, if the scene has camera and tags,
/// the camera. With ~regulator topic, it simulates arm and camera alone: the arm has the pressures
/// that a regulator measures, such as that of a board without an arm.
///
/// Subscribes
/// - pressure_command (PressureArray), with ~regulator scene: gauge [Pa]; omitted names keep their
///   command, and all 0 vents. If it stops, the regulator vents by itself
/// - pressure_measured (PressureArray), with ~regulator topic: gauge [Pa], of all actuators. While
///   there is none, there is neither truth nor picture
/// - ~tip_force (geometry_msgs/WrenchStamped): dead force on the true tip, base frame [N], at most
///   kMostTipForce, without torque; it adds to the scene's load and stays until the next message,
///   even if its publisher ends. A force needs arm.stiffness.K_eps_n
///
/// Publishes
/// - pressure_measured (PressureArray), with ~regulator scene: with every loop [Pa]
/// - truth (ArmShape): with every pressure_measured and its stamp, the shape that the arm has under
///   the scene's load and the force at its tip. If no shape balances them, neither
///   it nor a picture is published; this is counted and warned of at intervals
/// - image (sensor_msgs/Image, mono8), image/compressed (sensor_msgs/CompressedImage, gray JPEG):
///   each rendered only while it has subscribers; with the stamp of the truth that it shows
/// - camera_info (sensor_msgs/CameraInfo): just before each picture
/// - /clock (rosgraph_msgs/Clock): with every loop, if ~time_factor is set; it starts at the time
///   of the node's start
///
/// Parameters: SimulatedRigOptions.
///
/// ~rate and ~camera_rate are on a steady clock, independent of ~time_factor.
///
/// A bad command, reading or force is dropped, counted and warned of at intervals; the set points
/// or the force stay.
///
/// Ends with 0 if asked to, 1 if the ROS master is lost, 2 on a bad scene or parameter.
class SimulatedRigNode {
 public:
  /// @throws io::DocumentError, ParameterError or std::invalid_argument with every fault found.
  SimulatedRigNode();
  ~SimulatedRigNode();

  int finish() const { return photographer_.verdict(); }

 private:
  /// The arm at one time.
  struct Moment {
    ros::Time stamp;
    model::Shape shape;
  };

  void onCommand(const PressureArrayConstPtr& command);
  void onTipForce(const geometry_msgs::WrenchStampedConstPtr& wrench);
  void onReading(const PressureArrayConstPtr& reading);
  void onLoop(const ros::SteadyTimerEvent& event);
  static void drop(const std::string& topic, const std::string& fault, FaultCount& count);
  void noteInput();
  void noteSilence(const ros::SteadyTime& now);
  /// The arm at its present effective pressures.
  void publishTruth(std_msgs::Header header);
  void publishClock();
  void takePictures();
  void publishPicture(simulation::SimulatedCamera& camera, vision::JpegEncoder& encoder);

  const SimulatedRigOptions options_;
  const io::Scene scene_;
  std::optional<regulator::SimulatedRegulator> regulator_;  ///< with ~regulator scene
  simulation::TrueArm true_arm_;
  model::ArmResponse response_;  // of the true arm
  Eigen::VectorXd command_;      ///< in force, inside the limits [Pa]
  ros::SteadyTime last_step_;    ///< of the regulator
  ros::SteadyTime last_input_;   ///< last command, or last reading
  bool silent_;                  ///< none arrives; the regulator is vented
  bool heard_ = false;           ///< one has arrived
  ros::Time clock_;              ///< if ~time_factor is set
  FaultCount bad_inputs_, bad_forces_, no_truths_;

  ros::NodeHandle node_, private_node_{"~"};
  ros::Publisher measured_publisher_, truth_publisher_, clock_publisher_;
  ros::Publisher image_publisher_, compressed_publisher_, info_publisher_;
  ros::Subscriber pressure_subscriber_, force_subscriber_;
  ros::SteadyTimer loop_timer_;

  basics::Mutex mutex_;
  basics::Condition wake_;
  bool stop_ HELIX_ARM_GUARDED_BY(mutex_) = false;
  std::optional<Moment> now_ HELIX_ARM_GUARDED_BY(mutex_);  ///< the last one
  /// Renders, since a picture takes longer than a loop of the regulator.
  GuardedThread photographer_;
};

}  // namespace helix_arm::ros_bridge
