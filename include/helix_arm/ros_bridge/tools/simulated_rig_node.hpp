#pragma once

#include <memory>
#include <optional>
#include <string>

#include <ros/node_handle.h>
#include <ros/steady_timer.h>

#include "helix_arm/PressureArray.h"
#include "helix_arm/basics/mutex.hpp"
#include "helix_arm/io/scene.hpp"
#include "helix_arm/ros_bridge/common/diagnostics.hpp"
#include "helix_arm/ros_bridge/common/guarded_thread.hpp"
#include "helix_arm/ros_bridge/common/run_node.hpp"
#include "helix_arm/vision/jpeg.hpp"

namespace helix_arm::ros_bridge {

/// Private parameters of simulated_rig.
struct SimulatedRigOptions {
  std::string scene;          ///< ~scene: as pressure_command's; required
  double rate = 100.0;        ///< ~rate: of the regulator, 1 to 1000 [Hz]
  double camera_rate = 15.0;  ///< ~camera_rate: of the pictures, 0.1 to 100 [Hz]
  std::string frame_prefix;   ///< ~frame_prefix: "", set before arm_base and camera_optical
  /// ~command_timeout: without commands for so long the regulator vents by itself, 0.01 to 60 [s]
  double command_timeout = 0.5;
  /// ~time_factor: 0 lives in the time of the other nodes; more makes this node their clock, which
  /// needs use_sim_time: so many seconds pass in one, 0.01 to 1000.
  double time_factor = 0.0;

  /// @throws ParameterError with every fault.
  static SimulatedRigOptions load();
};

/// Stands in for the hardware of a scene: regulator, true arm and, where the scene has camera and
/// tags, the camera that looks at it.
///
/// Subscribes
/// - pressure_command (PressureArray): gauge [Pa]; names left out keep their command, and all 0
/// vents.
///   Where it stops coming the regulator vents by itself
///
/// Publishes
/// - pressure_measured (PressureArray): with every loop [Pa]
/// - truth (ArmShape): with every loop, the shape that the arm has under the scene's load, with the
///   stamp of that pressure_measured. Where no shape holds the load there is none, nor a picture:
///   that is counted and warned of once in a while
/// - image (sensor_msgs/Image, mono8), image/compressed (sensor_msgs/CompressedImage, gray JPEG):
///   each rendered only while someone subscribes to it; stamped like the truth that it shows
/// - camera_info (sensor_msgs/CameraInfo): just before each picture
/// - /clock (rosgraph_msgs/Clock): with every loop, where ~time_factor is set; it begins at the
/// time
///   of the node's start
///
/// Parameters: SimulatedRigOptions.
///
/// ~rate and ~camera_rate are by a steady clock, whatever ~time_factor says.
///
/// A bad command is dropped, counted and warned of once in a while; the set points stay.
///
/// Ends with 0 when asked to, 1 when the ROS master is lost, 2 on a bad scene or parameter.
class SimulatedRigNode {
 public:
  /// @throws io::DocumentError, ParameterError or std::invalid_argument with every fault found.
  SimulatedRigNode();
  ~SimulatedRigNode();

  int finish() const { return photographer_.verdict(); }

 private:
  /// The arm at one moment.
  struct Moment {
    ros::Time stamp;
    model::Shape shape;
  };

  void onCommand(const PressureArrayConstPtr& command);
  void onLoop(const ros::SteadyTimerEvent& event);
  void ventWhenSilent(const ros::SteadyTime& now);
  void publishClock();
  void takePictures();
  void publishPicture(simulation::SimulatedCamera& camera, vision::JpegEncoder& encoder);

  const SimulatedRigOptions options_;
  const io::Scene scene_;
  regulator::SimulatedRegulator regulator_;
  const simulation::TrueArm true_arm_;
  Eigen::VectorXd command_;    ///< in force, inside the limits [Pa]
  ros::SteadyTime last_step_;  ///< of the regulator
  ros::SteadyTime last_command_;
  bool silent_ = true;  ///< nobody commands, and it is vented
  ros::Time clock_;     ///< where ~time_factor is set
  FaultCount bad_commands_, no_truths_;

  ros::NodeHandle node_;
  ros::Publisher measured_publisher_, truth_publisher_, clock_publisher_;
  ros::Publisher image_publisher_, compressed_publisher_, info_publisher_;
  ros::Subscriber command_subscriber_;
  ros::SteadyTimer loop_timer_;

  basics::Mutex mutex_;
  basics::Condition wake_;
  bool stop_ HELIX_ARM_GUARDED_BY(mutex_) = false;
  std::optional<Moment> now_ HELIX_ARM_GUARDED_BY(mutex_);  ///< the last one
  GuardedThread photographer_;  ///< renders: a picture takes longer than a loop of the regulator
};

}  // namespace helix_arm::ros_bridge
