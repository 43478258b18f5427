#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "helix_arm/control/valve_orders.hpp"
#include "helix_arm/regulator/serial_profile.hpp"
#include "helix_arm/regulator/simulated_regulator.hpp"
#include "helix_arm/simulation/device_fault.hpp"

namespace helix_arm::simulation {

/// What an emulated regulator on a serial line is like.
struct SerialDeviceConfig {
  regulator::SerialProfile profile;               ///< what it speaks
  std::vector<std::string> addresses;             ///< (channels) where its lines have {address}
  int channels = 1;                               ///< >= 1
  regulator::SimulatedRegulatorConfig regulator;  ///< what its valves are like
  /// Where a symlink to its line is put and, at the end, taken away; empty: none. A symlink that is
  /// there already is replaced, unless it points to a pseudo terminal that exists.
  std::string link;
  double period = 0.02;    ///< of lines that come unasked, > 0 [s]
  std::uint32_t seed = 1;  ///< of the garbage
};

/// A pressure regulator on the other end of a pseudo terminal: speaks a profile's lines from the
/// device's side, follows its set points as time goes by, and goes wrong on demand.
///
/// It is as stubborn as the devices are: closed, or vented by a line that is no set point, it takes
/// set points but does not follow them until it is told to resume, where the profile knows such
/// lines; it speaks unasked only once it was sent the last of the profile's start lines; and it
/// vents by itself where the profile has a watchdog.
class SerialDevice {
 public:
  /// Begins to answer, vented.
  /// @throws std::invalid_argument naming what breaks its rule.
  /// @throws std::runtime_error where the system gives no terminal or the link cannot be made;
  /// naming the other terminal where the link points to one.
  explicit SerialDevice(SerialDeviceConfig config);
  ~SerialDevice();
  SerialDevice(const SerialDevice&) = delete;
  SerialDevice& operator=(const SerialDevice&) = delete;

  // All of these may be called by any thread at any time.

  /// Where to connect: the link, or the terminal's own path, which a restart changes.
  std::string path() const;
  /// From the next line on; kRestart takes place at once and then counts as kNone.
  void setFault(DeviceFault fault);
  DeviceFault fault() const;

  Eigen::VectorXd pressure() const;            ///< (channels) true, gauge, now [Pa]
  Eigen::VectorXd setPoint() const;            ///< (channels) last taken, gauge [Pa]
  std::vector<control::Valve> valves() const;  ///< (channels)
  std::uint64_t lines() const;                 ///< that it understood
  std::uint64_t restarts() const;              ///< that are over
  /// When the last line with set points came, on the steady clock [s]; NaN before the first.
  double lastSetTime() const;

 private:
  class Worker;
  std::unique_ptr<Worker> worker_;
};

}  // namespace helix_arm::simulation
