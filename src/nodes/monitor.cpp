#include "helix_arm/ros_bridge/common/names.hpp"
#include "helix_arm/ros_bridge/tools/monitor_node.hpp"

int main(int argc, char** argv) {
  using namespace helix_arm::ros_bridge;
  return runNode<MonitorNode>(argc, argv, names::kMonitorNode);
}
