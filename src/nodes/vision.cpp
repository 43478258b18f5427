#include "helix_arm/ros_bridge/common/names.hpp"
#include "helix_arm/ros_bridge/vision/vision_node.hpp"

int main(int argc, char** argv) {
  using namespace helix_arm::ros_bridge;
  return runNode<VisionNode>(argc, argv, names::kVisionNode);
}
