#include "ros_bridge/common/pneumatics.hpp"

#include <stdexcept>

namespace helix_arm::ros_bridge {

io::Scene requirePneumatic(io::Scene scene) {
  std::string faults;
  for (int i = 0; i < scene.arm.actuatorCount(); ++i) {
    const model::Actuator& actuator = scene.arm.actuator(i);
    if (model::isPressure(actuator.drive)) continue;
    faults += "\n" + actuator.name + " is a tendon; expected muscles and bellows only";
  }
  if (!faults.empty()) {
    throw std::invalid_argument("scene " + scene.name + " cannot be driven by pressure:" + faults);
  }
  return scene;
}

}  // namespace helix_arm::ros_bridge
