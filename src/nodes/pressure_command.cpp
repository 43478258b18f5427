#include "helix_arm/ros_bridge/common/names.hpp"
#include "helix_arm/ros_bridge/pressure/pressure_command_node.hpp"

int main(int argc, char** argv) {
  using namespace helix_arm::ros_bridge;
  return runNode<PressureCommandNode>(argc, argv, names::kPressureCommandNode);
}
