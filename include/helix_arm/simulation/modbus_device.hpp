#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <memory>
#include <vector>

#include "helix_arm/control/safety.hpp"
#include "helix_arm/regulator/modbus_profile.hpp"
#include "helix_arm/regulator/simulated_regulator.hpp"
#include "helix_arm/simulation/device_fault.hpp"

namespace helix_arm::simulation {

/// Configuration of an emulated Modbus device.
struct ModbusDeviceConfig {
  regulator::ModbusProfile profile;
  int places = 8;  ///< number of outlets, >= 1; the last slot has all of its outlets
  regulator::SimulatedRegulatorConfig regulator;
  int port = 0;                   ///< port on 127.0.0.1; 0: any free one
  double activation_time = 0.02;  ///< time that an app takes to start, >= 0 [s]
};

/// Emulates a pressure regulator with Modbus TCP: a server on 127.0.0.1 in its own thread, with
/// simulated pressures that follow the steady clock. Serves several connections. All members are
/// thread-safe.
///
/// It starts vented. A device with apps starts not ready, regulates once it is acknowledged and
/// commanded to, and keeps its air while no app runs. When the last connection is closed, by either
/// side, its outputs are reset, which ends its apps; a device without apps continues as commanded.
/// Access to registers that it does not have is refused, and so are writes to its inputs. A
/// pressure beyond a register's range reads as the limit of the range.
///
/// Faults: kHalfLine omits the second half of every reply; kGarbage replaces it by random bytes;
/// kWrongUnit reads a tenth (kPa for millibar); kNanText reads regulator::kNoReading; kSlow answers
/// after one and a half times the profile's timeout; kRestart closes all sockets for a moment.
/// After kSilence, all connections are closed and their data is lost.
class ModbusDevice {
 public:
  /// @throws std::invalid_argument on a broken rule; std::runtime_error naming the port if it
  /// cannot listen there.
  explicit ModbusDevice(const ModbusDeviceConfig& config);
  ~ModbusDevice();
  ModbusDevice(const ModbusDevice&) = delete;
  ModbusDevice& operator=(const ModbusDevice&) = delete;

  int port() const;

  /// kRestart becomes kNone by itself.
  void setFault(DeviceFault fault);
  DeviceFault fault() const;
  /// Gives a slot a fault that cannot be acknowledged: its app ends and does not start.
  void jam(int slot, bool jammed);

  Eigen::VectorXd pressure() const;            ///< true pressures (places), gauge [Pa]
  Eigen::VectorXd setPoint() const;            ///< set points as written (places), gauge [Pa]
  std::vector<control::Valve> valves() const;  ///< (places)
  std::uint64_t writes() const;                ///< number of accepted write requests
  double lastWrite() const;  ///< time of the last write, as steadyNow(); -infinity: never [s]
  int connections() const;   ///< number of open connections

 private:
  class Server;
  std::unique_ptr<Server> server_;
};

}  // namespace helix_arm::simulation
