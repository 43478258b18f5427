// One program for each node, compiled with its name.
#include "ros_bridge/common/run_node.hpp"

int main(int argc, char** argv) {
  using namespace helix_arm::ros_bridge;
  return runNode(argc, argv, HELIX_ARM_NODE, [] { return makeNode(HELIX_ARM_NODE); });
}
