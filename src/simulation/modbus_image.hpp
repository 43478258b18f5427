#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <memory>
#include <vector>

#include "helix_arm/simulation/modbus_device.hpp"
#include "modbus/modbus.h"

namespace helix_arm::simulation {

/// An emulated device behind its registers: their map, the apps of its slots, its pressures.
class ModbusImage {
 public:
  /// Not ready, vented.
  explicit ModbusImage(const ModbusDeviceConfig& config);

  /// What modbus_reply() answers from and writes to.
  modbus_mapping_t* map() { return map_.get(); }

  /// As after switching it on.
  void restart();
  /// Without anybody on the other end: apps that run end, and wait for another word.
  void loseLink();
  void jam(int slot, bool jammed);
  /// Whether such a request touches registers of the device alone.
  bool allows(int function, int first, int count) const;
  /// Lets time pass up to now [s].
  void catchUp(double now);
  /// Brings the input registers up to date.
  void measure(DeviceFault fault);
  /// From now on read what is read now, under kStuckValue.
  void stick();
  void fail(regulator::AirFault fault) { regulator_.fail(fault); }
  /// Does what the output registers say.
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
  Eigen::VectorXd follows_;  // what each place goes to [Pa]
  std::vector<std::uint16_t> stuck_;
  double time_;  // of the pressures [s]
  std::unique_ptr<modbus_mapping_t, void (*)(modbus_mapping_t*)> map_;
};

}  // namespace helix_arm::simulation
