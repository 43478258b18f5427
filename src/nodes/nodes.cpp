#include <map>

#include "ros_bridge/common/run_node.hpp"
#include "ros_bridge/names.hpp"

namespace helix_arm::ros_bridge {

std::unique_ptr<Node> makeNode(const std::string& program) {
  static const std::map<std::string, std::unique_ptr<Node> (*)()> kNodes = {
      {names::kCalibrationNode, makeCalibration},
      {names::kPressureCommandNode, makePressureCommand},
      {names::kSimulatedRigNode, makeSimulatedRig},
      {names::kVisionNode, makeVision},
      {names::kVisualServoNode, makeVisualServo}};
  return kNodes.at(program)();
}

}  // namespace helix_arm::ros_bridge
