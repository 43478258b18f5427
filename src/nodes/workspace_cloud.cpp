#include "helix_arm/ros_bridge/common/names.hpp"
#include "helix_arm/ros_bridge/tools/workspace_cloud_node.hpp"

int main(int argc, char** argv) {
  using namespace helix_arm::ros_bridge;
  return runNode<WorkspaceCloudNode>(argc, argv, names::kWorkspaceCloudNode);
}
