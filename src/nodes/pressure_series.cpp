#include "helix_arm/ros_bridge/names.hpp"
#include "helix_arm/ros_bridge/pressure_series_node.hpp"

int main(int argc, char** argv) {
  using namespace helix_arm::ros_bridge;
  return runNode<PressureSeriesNode>(argc, argv, names::kPressureSeriesNode);
}
