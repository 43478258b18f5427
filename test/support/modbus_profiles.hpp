#pragma once

#include <numeric>

#include "simulation/emulated_device.hpp"

namespace helix_arm::test {

/// Of an answer, on a machine that is busy [s].
inline constexpr double kPatience = 0.5;

/// As config/regulators/festo_vtem.yaml has it, with a shorter wait for its apps and a longer one
/// for its answers.
inline regulator::ModbusProfile vtemProfile() {
  regulator::ModbusProfile profile;
  profile.name = "festo_vtem";
  profile.timeout = kPatience;
  profile.highest_count = 7000;
  profile.outlets = 2;
  profile.output_base = 40003;
  profile.output_stride = 3;
  profile.output_pressure = 1;
  profile.input_base = 45395;
  profile.input_stride = 3;
  profile.input_pressure = 1;
  regulator::ModbusApp app;
  app.regulate = 195;
  app.off = 61;
  app.acknowledge = 126;
  app.status_mask = 255;
  app.ready = 125;
  app.running = 131;
  app.activation_time = 0.3;
  profile.app = app;
  return profile;
}

/// As config/regulators/festo_mpa.yaml has it, with a longer wait for its answers.
inline regulator::ModbusProfile mpaProfile() {
  regulator::ModbusProfile profile;
  profile.name = "festo_mpa";
  profile.timeout = kPatience;
  profile.highest_count = 10000;
  profile.output_base = 40003;
  profile.input_base = 45395;
  profile.input_stride = 3;
  return profile;
}

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
