#include "helix_arm/ros_bridge/pneumatics.hpp"

#include <stdexcept>

#include <ros/console.h>

namespace helix_arm::ros_bridge {

io::Scene requirePneumatic(io::Scene scene) {
  std::string faults;
  for (int i = 0; i < scene.arm.actuatorCount(); ++i) {
    const model::Actuator& actuator = scene.arm.actuator(i);
    if (actuator.drive == model::Drive::kPressure) continue;
    faults += "\n" + actuator.name + " is a tendon; expected muscles and bellows only";
  }
  if (!faults.empty()) {
    throw std::invalid_argument("scene " + scene.name + " cannot be driven by pressure:" + faults);
  }
  return scene;
}

regulator::SimulatedRegulator makeRegulator(const io::Scene& scene) {
  if (!scene.regulator) {
    throw std::invalid_argument("scene " + scene.name +
                                " has no regulator; add the section `regulator` to it");
  }
  if (regulator::isHardware(*scene.regulator)) {
    throw std::invalid_argument("scene " + scene.name + " has a regulator of its own, " +
                                regulator::describe(*scene.regulator) +
                                "; only one with regulator.simulated can be simulated");
  }
  const auto& config = std::get<regulator::SimulatedRegulatorConfig>(*scene.regulator);
  for (int i = 0; i < scene.arm.actuatorCount(); ++i) {
    const model::Actuator& actuator = scene.arm.actuator(i);
    const model::Range& limits = actuator.limits;
    if (limits.lower < 0 || limits.upper > config.supply_pressure) {
      ROS_WARN("%s may be asked for %.0f to %.0f kPa, but the simulated supply gives 0 to %.0f kPa",
               actuator.name.c_str(), limits.lower / 1e3, limits.upper / 1e3,
               config.supply_pressure / 1e3);
    }
  }
  return {scene.arm.actuatorCount(), config};
}

}  // namespace helix_arm::ros_bridge
