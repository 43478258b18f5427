#include "helix_arm/ros_bridge/common/names.hpp"
#include "helix_arm/ros_bridge/tools/pressure_series_node.hpp"

int main(int argc, char** argv) {
  using namespace helix_arm::ros_bridge;
  return runNode<PressureSeriesNode>(argc, argv, names::kPressureSeriesNode);
}
