#include "regulator_setup.hpp"

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <stdexcept>
#include <variant>

#include "helix_arm/regulator/config.hpp"
#include "ros_bridge/common/log.hpp"

namespace helix_arm::ros_bridge {
namespace {

constexpr double kShare =
    0.9;  // of a turn, so that a reading is available when the next one begins
constexpr double kLongestGap = 0.4;  // between turns [s]
constexpr double kMissedTurns = 4;   // of a slow loop, before it counts as stopped
constexpr double kPatience = 1.25;   // of the line, so that the safety core detects a gap first

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

}  // namespace

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

std::unique_ptr<regulator::RegulatorIo> startRegulatorIo(const io::Scene& scene, double rate,
                                                         int realtime_priority) {
  const regulator::Config& config = requireRegulator(scene);
  regulator::IoRules rules = regulator::ioRulesOf(scene.safety.rules);
  rules.period = kShare / rate;
  rules.order_timeout = kPatience * longestGap(rate);
  rules.realtime_priority = realtime_priority;
  const int channels = scene.arm.actuatorCount();
  logInfo("%s: regulator %s", scene.name.c_str(), regulator::describe(config).c_str());
  auto driver = regulator::makeDriver(config, channels);
  if (std::isfinite(driver->watchdog())) {
    logInfo("%s: by its profile the regulator vents itself if no line comes for %g s; test this",
            scene.name.c_str(), driver->watchdog());
  }
  if (const auto* simulated = std::get_if<regulator::SimulatedRegulatorConfig>(&config)) {
    warnOfShortSupply(scene.arm, *simulated);
  }
  return std::make_unique<regulator::RegulatorIo>(std::move(driver), channels, rules);
}

double longestGap(double rate) { return std::max(kLongestGap, kMissedTurns / rate); }

std::shared_ptr<regulator::GuardProcess> startGuardProcess(const std::string& scene_path,
                                                           int realtime_priority) {
  const auto program = std::filesystem::read_symlink("/proc/self/exe").parent_path() / "helix_arm";
  return std::make_shared<regulator::GuardProcess>(
      std::vector<std::string>{program.string(), "regulator", scene_path, "guard",
                               "--realtime-priority", std::to_string(realtime_priority)},
      realtime_priority);
}

}  // namespace helix_arm::ros_bridge
