#pragma once

#include <numeric>

#include "io/scene/regulator_profile.hpp"
#include "simulation/emulated_device.hpp"

namespace helix_arm::test {

/// Of an answer, on a machine that is busy [s].
inline constexpr double kPatience = 0.5;

/// A shipped profile with a longer wait for answers, and a shorter one for apps.
inline regulator::ModbusProfile shippedModbus(const std::string& name) {
  auto profile = std::get<regulator::ModbusProfile>(io::loadRegulatorProfile(name));
  profile.timeout = kPatience;
  if (profile.app) profile.app->activation_time = 0.3;
  return profile;
}

inline regulator::ModbusProfile vtemProfile() { return shippedModbus("festo_vtem"); }
inline regulator::ModbusProfile mpaProfile() { return shippedModbus("festo_mpa"); }

/// A quick device without noise: what it reads is what it has.
inline simulation::EmulatedDeviceConfig quietDevice(const regulator::ModbusProfile& profile,
                                                    int places) {
  simulation::EmulatedDeviceConfig config;
  std::vector<int> slots(static_cast<std::size_t>(places));
  std::iota(slots.begin(), slots.end(), 0);
  config.regulator = regulator::ModbusConfig{profile, "127.0.0.1", 0, slots};
  config.channels = places;
  config.valves.time_constant = 0.01;
  config.valves.noise = 0;
  return config;
}

}  // namespace helix_arm::test
