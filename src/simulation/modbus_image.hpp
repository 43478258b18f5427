#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <memory>
#include <vector>

#include "helix_arm/simulation/modbus_device.hpp"
#include "modbus/modbus.h"

namespace helix_arm::simulation {

/// State of an emulated device: its register map, the apps of its slots, its pressures.
class ModbusImage {
 public:
  /// Not ready, vented.
  explicit ModbusImage(const ModbusDeviceConfig& config);

  /// The registers that modbus_reply() reads and writes.
  modbus_mapping_t* map() { return map_.get(); }

  /// Restarts, as after power-on.
  void restart();
  /// The last connection is gone: running apps end and wait for another command.
  void loseLink();
  void jam(int slot, bool jammed);
  /// Whether a request touches only registers that the device has.
  bool allows(int function, int first, int count) const;
  /// Advances the simulation to now [s].
  void catchUp(double now);
  /// Updates the input registers.
  void measure(DeviceFault fault);
  /// Freezes the readings, for kStuckValue.
  void stick();
  void fail(regulator::AirFault fault) { regulator_.fail(fault); }
  /// Executes the output registers.
  void obey(double now);

  const Eigen::VectorXd& pressure() const { return regulator_.pressure(); }
  Eigen::VectorXd setPoint() const;
  std::vector<control::Valve> valves() const;
  int slots() const { return static_cast<int>(slots_.size()); }

 private:
  enum class App { kNotReady, kReady, kStarting, kRunning };
  struct Slot {
    App app = App::kNotReady;
    double since = 0;  // it began to start [s]
    bool jammed = false;
  };

  void clear();
  std::uint16_t& output(int number) const;
  std::uint16_t& input(int number) const;
  int count(int place) const { return output(profile_.setPoint(place)); }
  void regulate();

  const regulator::ModbusProfile profile_;
  const regulator::SimulatedRegulatorConfig rules_;
  const double activation_time_;
  std::vector<Slot> slots_;
  regulator::SimulatedRegulator regulator_;
  Eigen::VectorXd follows_;  // pressure that each place follows [Pa]
  std::vector<std::uint16_t> stuck_;
  double time_;  // of the pressures [s]
  std::unique_ptr<modbus_mapping_t, void (*)(modbus_mapping_t*)> map_;
};

}  // namespace helix_arm::simulation
