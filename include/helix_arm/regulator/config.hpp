#pragma once

#include <memory>
#include <string>
#include <variant>
#include <vector>

#include "helix_arm/regulator/driver.hpp"
#include "helix_arm/regulator/line_format.hpp"
#include "helix_arm/regulator/modbus_profile.hpp"
#include "helix_arm/regulator/simulated_regulator.hpp"

namespace helix_arm::regulator {

/// A regulator on a serial line that uses lines of text.
struct SerialConfig {
  SerialProfile profile;
  std::string device;                  ///< /dev/ttyUSB0, or better /dev/serial/by-id/...
  std::vector<std::string> addresses;  ///< (actuators) values of the profile's {address}
};

/// A regulator on Modbus TCP.
struct ModbusConfig {
  ModbusProfile profile;
  std::string host;  ///< name or address
  int port = 502;
  std::vector<int> slots;  ///< (actuators) outlet in the device, from 0
};

/// The regulator of a scene.
using Config = std::variant<SimulatedRegulatorConfig, SerialConfig, ModbusConfig>;

/// "simulated", "ascii_serial" or "modbus_tcp", with its profile and address: "ascii_serial alicat
/// at /dev/ttyUSB0".
std::string describe(const Config& config);
/// Positions of the actuators in the device, in their order: "addresses A, B, C" or "slots 0, 1,
/// 2"; empty for a simulated one.
std::string describeChannels(const Config& config);
/// Position of one channel in the device: its address or slot, else its number from 0.
std::string addressOf(const Config& config, int channel);
/// Whether it is real hardware, which moves air.
bool isHardware(const Config& config);
/// Whether its channels can be closed: FaultAction::kClose.
bool closesValves(const Config& config);

/// Makes the driver of a regulator with this number of channels; it is not connected yet.
/// @throws std::invalid_argument if the configuration does not have this number of channels.
std::unique_ptr<Driver> makeDriver(const Config& config, int channels);

}  // namespace helix_arm::regulator
