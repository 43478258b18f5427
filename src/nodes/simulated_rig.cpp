#include "helix_arm/ros_bridge/names.hpp"
#include "helix_arm/ros_bridge/simulated_rig_node.hpp"

int main(int argc, char** argv) {
  using namespace helix_arm::ros_bridge;
  return runNode<SimulatedRigNode>(argc, argv, names::kSimulatedRigNode);
}
