#include "helix_arm/ros_bridge/common/names.hpp"
#include "helix_arm/ros_bridge/follow/sight_loop_node.hpp"

int main(int argc, char** argv) {
  using namespace helix_arm::ros_bridge;
  return runNode<SightLoopNode>(argc, argv, names::kSightLoopNode);
}
