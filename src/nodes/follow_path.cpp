#include "helix_arm/ros_bridge/common/names.hpp"
#include "helix_arm/ros_bridge/tools/follow_path_node.hpp"

int main(int argc, char** argv) {
  using namespace helix_arm::ros_bridge;
  return runNode<FollowPathNode>(argc, argv, names::kFollowPathNode);
}
