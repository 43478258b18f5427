#include "helix_arm/ros_bridge/names.hpp"
#include "helix_arm/ros_bridge/workspace_cloud_node.hpp"

int main(int argc, char** argv) {
  using namespace helix_arm::ros_bridge;
  return runNode<WorkspaceCloudNode>(argc, argv, names::kWorkspaceCloudNode);
}
