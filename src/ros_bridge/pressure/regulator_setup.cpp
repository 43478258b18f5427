#include "regulator_setup.hpp"

#include <stdexcept>
#include <variant>

#include "helix_arm/regulator/config.hpp"
#include "ros_bridge/common/log.hpp"

namespace helix_arm::ros_bridge {

void warnOfShortSupply(const model::Arm& arm, const regulator::SimulatedRegulatorConfig& config) {
  for (int i = 0; i < arm.actuatorCount(); ++i) {
    const model::Actuator& actuator = arm.actuator(i);
    const model::Range& limits = actuator.limits;
    if (limits.lower < 0 || limits.upper > config.supply_pressure) {
      logWarning("%s has limits of %.0f to %.0f kPa, but the simulated supply gives 0 to %.0f kPa",
                 actuator.name.c_str(), limits.lower / 1e3, limits.upper / 1e3,
                 config.supply_pressure / 1e3);
    }
  }
}

const regulator::Config& requireRegulator(const io::Scene& scene) {
  if (!scene.regulator) {
    throw std::invalid_argument("scene " + scene.name +
                                " has no regulator; add the section `regulator` to it");
  }
  return *scene.regulator;
}

regulator::SimulatedRegulator makeSimulatedRegulator(const io::Scene& scene) {
  const regulator::Config& config = requireRegulator(scene);
  const auto* const simulated = std::get_if<regulator::SimulatedRegulatorConfig>(&config);
  if (simulated == nullptr) {
    throw std::invalid_argument("scene " + scene.name + " has another regulator, " +
                                regulator::describe(config) + "; expected regulator.simulated");
  }
  warnOfShortSupply(scene.arm, *simulated);
  return {scene.arm.actuatorCount(), *simulated};
}

}  // namespace helix_arm::ros_bridge
