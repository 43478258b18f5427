#include "ros_bridge/calibration/calibration_node.hpp"
#include "ros_bridge/names.hpp"
#include "ros_bridge/common/run_node.hpp"
#include "ros_bridge/follow/visual_servo_node.hpp"
#include "ros_bridge/pressure/pressure_command_node.hpp"
#include "ros_bridge/tools/follow_path_node.hpp"
#include "ros_bridge/tools/monitor_node.hpp"
#include "ros_bridge/tools/pressure_series_node.hpp"
#include "ros_bridge/tools/simulated_rig_node.hpp"
#include "ros_bridge/tools/workspace_cloud_node.hpp"
#include "ros_bridge/vision/vision_node.hpp"

/// The main functions of the nodes, by the names of their programs; compiled together.
namespace helix_arm::ros_bridge::mains {

int calibration(int argc, char** argv) {
  return runNode<CalibrationNode>(argc, argv, names::kCalibrationNode);
}

int follow_path(int argc, char** argv) {
  return runNode<FollowPathNode>(argc, argv, names::kFollowPathNode);
}

int monitor(int argc, char** argv) {
  return runNode<MonitorNode>(argc, argv, names::kMonitorNode);
}

int pressure_command(int argc, char** argv) {
  return runNode<PressureCommandNode>(argc, argv, names::kPressureCommandNode);
}

int pressure_series(int argc, char** argv) {
  return runNode<PressureSeriesNode>(argc, argv, names::kPressureSeriesNode);
}

int visual_servo(int argc, char** argv) {
  return runNode<VisualServoNode>(argc, argv, names::kVisualServoNode);
}

int simulated_rig(int argc, char** argv) {
  return runNode<SimulatedRigNode>(argc, argv, names::kSimulatedRigNode);
}

int vision(int argc, char** argv) { return runNode<VisionNode>(argc, argv, names::kVisionNode); }

int workspace_cloud(int argc, char** argv) {
  return runNode<WorkspaceCloudNode>(argc, argv, names::kWorkspaceCloudNode);
}

}  // namespace helix_arm::ros_bridge::mains
