#include "node_mains.hpp"

#include "ros_bridge/calibration/calibration_node.hpp"
#include "ros_bridge/common/names.hpp"
#include "ros_bridge/common/run_node.hpp"
#include "ros_bridge/follow/visual_servo_node.hpp"
#include "ros_bridge/pressure/pressure_command_node.hpp"
#include "ros_bridge/tools/follow_path_node.hpp"
#include "ros_bridge/tools/monitor_node.hpp"
#include "ros_bridge/tools/pressure_series_node.hpp"
#include "ros_bridge/tools/simulated_rig_node.hpp"
#include "ros_bridge/tools/workspace_cloud_node.hpp"
#include "ros_bridge/vision/vision_node.hpp"

namespace helix_arm::ros_bridge {

int runCalibration(int argc, char** argv) {
  return runNode<CalibrationNode>(argc, argv, names::kCalibrationNode);
}

int runFollowPath(int argc, char** argv) {
  return runNode<FollowPathNode>(argc, argv, names::kFollowPathNode);
}

int runMonitor(int argc, char** argv) {
  return runNode<MonitorNode>(argc, argv, names::kMonitorNode);
}

int runPressureCommand(int argc, char** argv) {
  return runNode<PressureCommandNode>(argc, argv, names::kPressureCommandNode);
}

int runPressureSeries(int argc, char** argv) {
  return runNode<PressureSeriesNode>(argc, argv, names::kPressureSeriesNode);
}

int runVisualServo(int argc, char** argv) {
  return runNode<VisualServoNode>(argc, argv, names::kVisualServoNode);
}

int runSimulatedRig(int argc, char** argv) {
  return runNode<SimulatedRigNode>(argc, argv, names::kSimulatedRigNode);
}

int runVision(int argc, char** argv) { return runNode<VisionNode>(argc, argv, names::kVisionNode); }

int runWorkspaceCloud(int argc, char** argv) {
  return runNode<WorkspaceCloudNode>(argc, argv, names::kWorkspaceCloudNode);
}

}  // namespace helix_arm::ros_bridge
