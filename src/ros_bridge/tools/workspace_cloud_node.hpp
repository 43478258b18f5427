#pragma once

#include <string>
#include <vector>

#include <ros/node_handle.h>
#include <ros/steady_timer.h>

#include "helix_arm/io/scene.hpp"
#include "helix_arm/statics/workspace.hpp"
#include "ros_bridge/common/reload_server.hpp"
#include "ros_bridge/common/run_node.hpp"

namespace helix_arm::ros_bridge {

/// Private parameters of workspace_cloud.
struct WorkspaceCloudOptions {
  std::string scene;  ///< ~scene: as pressure_command's; required
  /// ~scene_folder: folder from which ~reload accepts scenes, besides those of the package and
  /// ~scene; default: `helix_arm` below ROS_HOME.
  std::string scene_folder;
  int count = 100000;        ///< ~count: inputs to sample, 1 to 2000000
  int seed = 1;              ///< ~seed: of the inputs, >= 0
  std::string frame_prefix;  ///< ~frame_prefix: as pressure_command's

  /// @throws ParameterError with every fault.
  static WorkspaceCloudOptions load();
};

/// Shows the reachable tip positions.
///
/// Publishes
/// - workspace (sensor_msgs/PointCloud2), latched, once it is complete, and empty when a reload
///   starts a new one: tips at inputs drawn evenly within their limits, in the arm's base frame,
///   float32: x, y, z [m] and, if all inputs are pressures, the tip displacement [m] for an error
///   of 1 kPa in every pressure (per_kpa_m), of 1 mm in every free length (per_mm_m) and of 1 % in
///   the stiffness (per_percent_K_m)
///
/// Service
/// - ~reload (Reload): another file of the same rig, whose cloud replaces the present one once it
///   is complete
///
/// Parameters: WorkspaceCloudOptions.
///
/// Ends with 0 if asked to, 1 if the ROS master is lost, 2 on a bad parameter or scene.
class WorkspaceCloudNode {
 public:
  /// @throws ParameterError or io::DocumentError with every fault.
  WorkspaceCloudNode();

  int finish() const { return kDone; }

 private:
  void adopt(io::Scene next);
  void onTick(const ros::SteadyTimerEvent& event);
  void publish();
  void tell() const;

  const WorkspaceCloudOptions options_;
  io::Scene scene_;
  const bool sensitivity_;  // depends on the drives, which no reload changes
  statics::Workspace workspace_;
  int sampled_ = 0, unbalanced_ = 0;
  std::vector<float> values_;  ///< values of the points, one after the other

  ros::NodeHandle node_;
  ros::Publisher publisher_;
  ros::SteadyTimer timer_;
  ReloadServer reload_;
};

}  // namespace helix_arm::ros_bridge
