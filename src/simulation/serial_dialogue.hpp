#pragma once

#include <Eigen/Core>
#include <optional>
#include <string>
#include <vector>

#include "helix_arm/control/valve_orders.hpp"
#include "helix_arm/regulator/serial_profile.hpp"
#include "helix_arm/regulator/simulated_regulator.hpp"
#include "helix_arm/simulation/device_fault.hpp"
#include "helix_arm/simulation/serial_device.hpp"

namespace helix_arm::simulation {

/// Protocol and valves of an emulated device, without line or clock.
class SerialDialogue {
 public:
  /// @throws std::invalid_argument naming the value and its rule.
  explicit SerialDialogue(const SerialDeviceConfig& config);

  /// Advances time by dt [s].
  void step(double dt);
  /// Executes a line.
  /// @return whether it was understood, whether it has set points, and the answer to send, if any.
  struct Outcome {
    bool understood = false;
    bool sets = false;
    std::optional<std::string> answer;  // without a terminator
  };
  Outcome take(const std::string& line, DeviceFault fault);
  /// The next unsolicited line, if it sends any.
  std::optional<std::string> unasked(DeviceFault fault);
  /// Freezes the readings, for kStuckValue.
  void rememberReadings() { stuck_ = simulated_.pressure(); }
  void fail(regulator::AirFault fault) { simulated_.fail(fault); }
  /// Restarts, as after power-on.
  void restart();

  const Eigen::VectorXd& pressure() const { return simulated_.pressure(); }
  const Eigen::VectorXd& setPoint() const { return set_point_; }
  const std::vector<control::Valve>& valves() const { return valves_; }

 private:
  std::string readings(const regulator::LineFormat& format, int channel, DeviceFault fault);
  Outcome takeText(const std::string& line, DeviceFault fault);
  Outcome takeOf(const std::string& line, int channel, DeviceFault fault);
  Outcome refusal() const;  // of a line that is not understood
  void apply();
  void ventAll();

  SerialDeviceConfig config_;
  regulator::SerialLines lines_;
  bool vents_by_mode_;  // by a line that is not a set point
  regulator::SimulatedRegulator simulated_;
  Eigen::VectorXd set_point_;
  std::vector<control::Valve> valves_;
  std::vector<bool> held_;  // (channels) until a resume line
  Eigen::VectorXd stuck_;
  bool speaks_ = false;
  double silence_ = 0;  // time since the last line [s]
};

}  // namespace helix_arm::simulation
