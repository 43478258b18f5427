#pragma once

#include <memory>
#include <string>

#include "helix_arm/io/scene.hpp"
#include "helix_arm/regulator/guard_process.hpp"
#include "helix_arm/regulator/regulator_io.hpp"
#include "helix_arm/regulator/simulated_regulator.hpp"

/// Access of a node to the regulator of its scene.
namespace helix_arm::ros_bridge {

/// @throws std::invalid_argument if the scene has none.
const regulator::Config& requireRegulator(const io::Scene& scene);

/// The simulated regulator of the scene; warns of actuators whose limits its supply does not reach.
/// @throws std::invalid_argument if the scene has none, or a hardware one.
regulator::SimulatedRegulator makeSimulatedRegulator(const io::Scene& scene);

/// Starts the scene's regulator with its own I/O. Logs it, and warns as makeSimulatedRegulator()
/// does.
/// @param rate               of the loop that gives the orders [Hz].
/// @param realtime_priority  as IoRules::realtime_priority.
/// @throws std::invalid_argument as requireRegulator(), regulator::makeDriver() and
/// regulator::RegulatorIo.
std::unique_ptr<regulator::RegulatorIo> startRegulatorIo(const io::Scene& scene, double rate,
                                                         int realtime_priority);

/// Longest gap between two turns of a loop at this rate [Hz] before the receiver of its orders may
/// have vented by itself [s].
double longestGap(double rate);

/// A guard that vents the scene's regulator if this process is killed.
/// @throws std::runtime_error as regulator::GuardProcess.
std::shared_ptr<regulator::GuardProcess> startGuardProcess(const std::string& scene_path,
                                                           int realtime_priority);

}  // namespace helix_arm::ros_bridge
