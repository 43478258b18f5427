#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <cstdint>
#include <string>
#include <vector>

#include <diagnostic_msgs/DiagnosticArray.h>
#include <ros/node_handle.h>
#include <ros/steady_timer.h>

#include "helix_arm/ArmShape.h"
#include "helix_arm/PressureArray.h"
#include "helix_arm/ros_bridge/run_node.hpp"

namespace helix_arm::ros_bridge {

/// Private parameters of monitor.
struct MonitorOptions {
  double seconds = 0.0;  ///< ~seconds: after the first model, to 86400; 0: until asked to end [s]
  double min_travel = 0.0;  ///< ~min_travel_m: of the tip, less is a fault, to 10 [m]
  double startup = 30.0;    ///< ~startup_s: that the first model may take, if ~seconds is set [s]
  double min_rate = 10.0;   ///< ~min_rate: slowest healthy rate of each topic, 0.1 to 1000 [Hz]

  /// @throws ParameterError with every fault.
  static MonitorOptions load();
};

/// Watches pressure_command from outside: prints a line a second, and a verdict at the end.
///
/// Subscribes
/// - pressure_command, pressure_measured (PressureArray)
/// - model (ArmShape)
/// - /diagnostics (diagnostic_msgs/DiagnosticArray): those of pressure_command in its namespace
///
/// Prints to stdout. Parameters: MonitorOptions.
///
/// Ends with 0 when all three topics flowed to the end at ~min_rate or more, with finite numbers,
/// diagnostics without error and no dropped target (but those of a second commander); else with 1,
/// saying what was missing.
class MonitorNode {
 public:
  /// @throws ParameterError with every fault.
  MonitorNode();

  /// Prints the summary and gives the verdict.
  int finish();

 private:
  /// What came on one topic.
  struct Stream {
    std::string topic;
    std::uint64_t count = 0;
    std::uint64_t printed = 0;  ///< of it, before the last line
    ros::SteadyTime first, last;
    bool finite = true;

    void arrived(bool is_finite);
    double rate() const;  ///< mean over the whole time [Hz]
  };

  void onCommand(const PressureArrayConstPtr& command);
  void onMeasured(const PressureArrayConstPtr& measured);
  void onModel(const ArmShapeConstPtr& model);
  void onDiagnostics(const diagnostic_msgs::DiagnosticArrayConstPtr& diagnostics);
  void onSecond(const ros::SteadyTimerEvent& event);
  void printLine(double seconds);
  double travel() const;  ///< diagonal of the box that the tip stayed in [m]
  std::vector<std::string> faults() const;

  const MonitorOptions options_;
  const ros::SteadyTime start_;
  Stream command_, measured_, model_;
  ros::SteadyTime last_line_;
  std::vector<double> pressure_;                   ///< last measured [Pa]
  Eigen::Vector3d tip_ = Eigen::Vector3d::Zero();  ///< of the last model, base frame [m]
  Eigen::AlignedBox3d reach_;                      ///< of all tips
  bool diagnosed_ = false;
  std::uint64_t dropped_ = 0;  ///< since the node started
  std::uint64_t refused_ = 0;  ///< of them, for a second commander
  std::string last_fault_;
  std::string error_;  ///< message of the last status at level ERROR

  ros::NodeHandle node_;
  ros::Subscriber command_subscriber_, measured_subscriber_, model_subscriber_;
  ros::Subscriber diagnostics_subscriber_;
  ros::SteadyTimer timer_;
};

}  // namespace helix_arm::ros_bridge
