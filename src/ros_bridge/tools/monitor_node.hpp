#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <cstdint>
#include <deque>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include <diagnostic_msgs/DiagnosticArray.h>
#include <ros/node_handle.h>
#include <ros/steady_timer.h>

#include "helix_arm/ArmShape.h"
#include "helix_arm/ModelError.h"
#include "helix_arm/PressureArray.h"
#include "helix_arm/SafetyState.h"
#include "helix_arm/VisionStatus.h"
#include "ros_bridge/common/reload_server.hpp"
#include "ros_bridge/common/run_node.hpp"

namespace helix_arm::ros_bridge {

/// Private parameters of monitor.
struct MonitorOptions {
  /// ~seconds: duration after the first model, to 86400; 0: until asked to end [s].
  double seconds = 0.0;
  double min_travel = 0.0;  ///< ~min_travel_m: minimum travel of the tip, to 10 [m]
  double startup = 30.0;   ///< ~startup_s: longest wait for the first model, if ~seconds is set [s]
  double min_rate = 10.0;  ///< ~min_rate: slowest healthy rate of each topic, 0.1 to 1000 [Hz]
  double min_measured_rate = 2.0;  ///< ~min_measured_rate: of `measured`, 0.1 to 1000 [Hz]
  /// ~scene: as pressure_command's; if it has camera and tags, `measured` is required as well.
  /// Without a scene, `measured` is shown but not required.
  std::string scene;
  /// ~scene_folder: folder from which ~reload accepts scenes, besides those of the package and
  /// ~scene; default: `helix_arm` below ROS_HOME.
  std::string scene_folder;

  /// @throws ParameterError with every fault.
  static MonitorOptions load();
};

/// Watches a running arm from outside: prints one line per second, and a verdict at the end.
///
/// Subscribes
/// - pressure_command, pressure_measured (PressureArray)
/// - model, measured (ArmShape); model_error (ModelError); vision_status (VisionStatus)
/// - safety_state (SafetyState): shown in each line
/// - /diagnostics (diagnostic_msgs/DiagnosticArray): those of pressure_command in its namespace
///
/// Service
/// - ~reload (Reload), if ~scene is set: another file of the same rig
///
/// Prints to stdout. Parameters: MonitorOptions.
///
/// Ends with 0 if pressures and shapes arrived to the end at ~min_rate or more, with finite
/// numbers, diagnostics without error and no dropped target (except those of a second commander,
/// while the arm was not enabled, and late ones); otherwise with 1 and the reason; 2 on a bad scene
/// or parameter.
class MonitorNode {
 public:
  /// @throws ParameterError or io::DocumentError with every fault.
  MonitorNode();

  /// Prints the summary and gives the verdict.
  int finish();

 private:
  /// Statistics of one topic.
  struct Stream {
    std::string topic;
    double min_rate;  ///< slowest healthy one [Hz]
    std::uint64_t count = 0;
    std::uint64_t printed = 0;  ///< count at the last line
    ros::SteadyTime first{}, last{};
    bool finite = true;

    void arrived(bool is_finite);
    double rate() const;  ///< mean over the whole time [Hz]
  };

  void onCommand(const PressureArrayConstPtr& command);
  void onMeasured(const PressureArrayConstPtr& measured);
  void onModel(const ArmShapeConstPtr& model);
  void onShape(const ArmShapeConstPtr& shape);
  void onModelError(const ModelErrorConstPtr& error);
  void onVisionStatus(const VisionStatusConstPtr& status);
  void onSafety(const SafetyStateConstPtr& safety);
  void onDiagnostics(const diagnostic_msgs::DiagnosticArrayConstPtr& diagnostics);
  void onSecond(const ros::SteadyTimerEvent& event);
  void printLine(double seconds);
  std::string visionText() const;
  std::string safetyText() const;
  std::vector<const Stream*> expected() const;
  double travel() const;  ///< diagonal of the bounding box of the tip [m]
  std::vector<std::string> faults() const;

  const MonitorOptions options_;
  std::optional<io::Scene> scene_;  ///< of ~scene
  const ros::SteadyTime start_;
  Stream command_, measured_, model_, shape_;  ///< shape_ of the topic `measured`
  ros::SteadyTime last_line_;
  std::vector<double> pressure_;                   ///< last measured [Pa]
  Eigen::Vector3d tip_ = Eigen::Vector3d::Zero();  ///< of the last model, base frame [m]
  Eigen::AlignedBox3d reach_;                      ///< of all tips
  std::optional<ModelError> model_error_;          ///< the last one
  std::optional<VisionStatus> vision_;             ///< the last one
  std::optional<SafetyState> safety_;              ///< the last one
  std::deque<double> tip_errors_;                  ///< of the latest model_error [m]
  bool diagnosed_ = false;
  std::uint64_t dropped_ = 0;  ///< since the node started
  /// Of these, for a second commander, while it was not enabled, or late.
  std::uint64_t refused_ = 0;
  std::string last_fault_;
  std::string error_;  ///< message of the last status at level ERROR

  ros::NodeHandle node_;
  ros::Subscriber command_subscriber_, measured_subscriber_, model_subscriber_;
  ros::Subscriber shape_subscriber_, error_subscriber_, vision_subscriber_;
  ros::Subscriber diagnostics_subscriber_, safety_subscriber_;
  std::unique_ptr<ReloadServer> reload_;
  ros::SteadyTimer timer_;
};

}  // namespace helix_arm::ros_bridge
