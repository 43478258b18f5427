#pragma once

/// The main functions of the nodes: runNode() of each node's class, compiled together.
namespace helix_arm::ros_bridge {

int runCalibration(int argc, char** argv);
int runFollowPath(int argc, char** argv);
int runMonitor(int argc, char** argv);
int runPressureCommand(int argc, char** argv);
int runPressureSeries(int argc, char** argv);
int runVisualServo(int argc, char** argv);
int runSimulatedRig(int argc, char** argv);
int runVision(int argc, char** argv);
int runWorkspaceCloud(int argc, char** argv);

}  // namespace helix_arm::ros_bridge
