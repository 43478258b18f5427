#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <memory>
#include <vector>

#include "helix_arm/control/valve_orders.hpp"
#include "helix_arm/regulator/modbus_profile.hpp"
#include "helix_arm/regulator/simulated_regulator.hpp"
#include "helix_arm/simulation/device_fault.hpp"

namespace helix_arm::simulation {

/// What an emulated Modbus device is like.
struct ModbusDeviceConfig {
  regulator::ModbusProfile profile;
  int places = 8;  ///< outlets, >= 1; the last slot has all of its own
  regulator::SimulatedRegulatorConfig regulator;
  int port = 0;                   ///< of 127.0.0.1; 0: a free one
  double activation_time = 0.02;  ///< that an app takes to start, >= 0 [s]
};

/// A pressure regulator that speaks Modbus TCP, emulated: a server on 127.0.0.1 in a thread of its
/// own, with simulated pressures behind it that go on with the steady clock. Serves several
/// connections. All members may be called from any thread.
///
/// It comes up vented; a device with apps comes up not ready, regulates once that is acknowledged
/// and told, and keeps its air where no app runs. Without a connection left, whichever side closed
/// the last one, its outputs are reset, which ends its apps; one without apps goes on as it was
/// told. Registers beside its own are refused, as are writes to its inputs. A pressure beyond a
/// register's range reads as its end.
///
/// Faults: kHalfLine leaves out the second half of every reply; kGarbage has random bytes in the
/// place of it; kWrongUnit reads a tenth (kPa for millibar); kNanText reads
/// regulator::kNoReading; kSlow answers after one and a half times the profile's timeout; kRestart
/// closes all sockets for a moment. After kSilence all connections are closed, and what they held
/// is lost.
class ModbusDevice {
 public:
  /// @throws std::invalid_argument on a broken rule; std::runtime_error naming the port where it
  /// cannot be listened at.
  explicit ModbusDevice(const ModbusDeviceConfig& config);
  ~ModbusDevice();
  ModbusDevice(const ModbusDevice&) = delete;
  ModbusDevice& operator=(const ModbusDevice&) = delete;

  int port() const;

  /// kRestart becomes kNone by itself.
  void setFault(DeviceFault fault);
  DeviceFault fault() const;
  /// Gives a slot a fault of its own that cannot be acknowledged: its app ends, and does not start.
  void jam(int slot, bool jammed);

  Eigen::VectorXd pressure() const;            ///< true ones (places), gauge [Pa]
  Eigen::VectorXd setPoint() const;            ///< as written (places), gauge [Pa]
  std::vector<control::Valve> valves() const;  ///< what each place does
  std::uint64_t writes() const;                ///< requests to write that were taken
  double lastWrite() const;  ///< when, of regulator::steadyNow(); -infinity: never [s]
  int connections() const;   ///< open ones

 private:
  class Server;
  std::unique_ptr<Server> server_;
};

}  // namespace helix_arm::simulation
