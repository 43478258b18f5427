#include "helix_arm/ros_bridge/calibration/calibration_node.hpp"
#include "helix_arm/ros_bridge/common/names.hpp"

int main(int argc, char** argv) {
  using namespace helix_arm::ros_bridge;
  return runNode<CalibrationNode>(argc, argv, names::kCalibrationNode);
}
