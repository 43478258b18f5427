#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "helix_arm/control/safety.hpp"
#include "helix_arm/regulator/serial_profile.hpp"
#include "helix_arm/regulator/simulated_regulator.hpp"
#include "helix_arm/simulation/device_fault.hpp"

namespace helix_arm::simulation {

/// Configuration of an emulated regulator on a serial line.
struct SerialDeviceConfig {
  regulator::SerialProfile profile;               ///< protocol
  std::vector<std::string> addresses;             ///< (channels) if its lines have {address}
  int channels = 1;                               ///< >= 1
  regulator::SimulatedRegulatorConfig regulator;  ///< dynamics of its valves
  /// Path of a symlink to its line, removed at the end; empty: none. An existing symlink is
  /// replaced, unless it points to an existing pseudo terminal.
  std::string link;
  double period = 0.02;    ///< period of unsolicited lines, > 0 [s]
  std::uint32_t seed = 1;  ///< seed of the garbage
};

/// Emulates a pressure regulator at the other end of a pseudo terminal: speaks the device's side of
/// a profile, follows its set points in real time, and produces faults on demand.
///
/// It behaves like the real devices. Once closed, or vented by a line that is not a set point, it
/// accepts set points but follows them only after a resume line, if the profile has such lines. It
/// sends unsolicited lines only after the last of the profile's start lines. It vents by itself if
/// the profile has a watchdog.
class SerialDevice {
 public:
  /// Starts answering, vented.
  /// @throws std::invalid_argument naming the value and its rule.
  /// @throws std::runtime_error if the system provides no terminal or the link cannot be made; the
  /// message names the other terminal if the link points to one.
  explicit SerialDevice(SerialDeviceConfig config);
  ~SerialDevice();
  SerialDevice(const SerialDevice&) = delete;
  SerialDevice& operator=(const SerialDevice&) = delete;

  // All members below are thread-safe.

  /// Path to connect to: the link, or the terminal's own path, which a restart changes.
  std::string path() const;
  /// Takes effect with the next line; kRestart takes effect immediately and then counts as kNone.
  void setFault(DeviceFault fault);
  DeviceFault fault() const;

  Eigen::VectorXd pressure() const;            ///< (channels) true, gauge, now [Pa]
  Eigen::VectorXd setPoint() const;            ///< (channels) last taken, gauge [Pa]
  std::vector<control::Valve> valves() const;  ///< (channels)
  std::uint64_t lines() const;                 ///< number of lines understood
  std::uint64_t restarts() const;              ///< number of completed restarts
  /// Time of the last line with set points, on the steady clock [s]; NaN before the first.
  double lastSetTime() const;

 private:
  class Worker;
  std::unique_ptr<Worker> worker_;
};

}  // namespace helix_arm::simulation
