#include "helix_arm/ros_bridge/common/names.hpp"
#include "helix_arm/ros_bridge/tools/simulated_rig_node.hpp"

int main(int argc, char** argv) {
  using namespace helix_arm::ros_bridge;
  return runNode<SimulatedRigNode>(argc, argv, names::kSimulatedRigNode);
}
