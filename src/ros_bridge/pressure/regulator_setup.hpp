#pragma once

#include "helix_arm/io/scene.hpp"
#include "helix_arm/regulator/config.hpp"
#include "helix_arm/regulator/simulated_regulator.hpp"

/// Access of a node to the regulator of its scene.
namespace helix_arm::ros_bridge {

/// @throws std::invalid_argument if the scene has none.
const regulator::Config& requireRegulator(const io::Scene& scene);

/// The simulated regulator of the scene; warns of actuators whose limits its supply does not reach.
/// @throws std::invalid_argument if the scene has none, or a hardware one.
regulator::SimulatedRegulator makeSimulatedRegulator(const io::Scene& scene);

/// Warns of actuators whose limits the supply of a simulated regulator does not reach.
void warnOfShortSupply(const model::Arm& arm, const regulator::SimulatedRegulatorConfig& config);

}  // namespace helix_arm::ros_bridge
