#pragma once

#include <memory>
#include <optional>
#include <string>

#include "helix_arm/regulator/config.hpp"
#include "helix_arm/regulator/driver.hpp"

namespace helix_arm::regulator {

/// Driver of a simulated regulator. It follows the steady clock and its link never fails.
/// @throws std::invalid_argument as SimulatedRegulator.
std::unique_ptr<Driver> simulatedDriver(const SimulatedRegulatorConfig& config, int channels);

/// Driver of a regulator on a serial line that uses lines of text, as its profile says.
///
/// One command is outstanding at a time; input received before it was sent is not taken as its
/// answer. If one channel does not answer, the others are still written, vented and read; the first
/// error is thrown afterwards, and readings that succeeded are set. No answer is a LinkError, a
/// wrong answer a BadReply. Set points are rounded down to the device's decimals.
///
/// connect() also vents and reads once: a device that cannot be read is not ready. A channel that
/// is to close vents if the device cannot close. On a device with one line for all channels, those
/// that vent are set to zero pressure while others regulate. read() does not ask a channel whose
/// answer to the last write() was a reading. Unsolicited readings are not waited for: it returns
/// those received since the last call, NaN if there are none.
///
/// write(), vent() and read() block for at most the profile's timeout per exchanged line; connect()
/// for three timeouts more.
///
/// @throws std::invalid_argument if the profile breaks its rules, or if its lines have {address}
/// and the addresses are not one per channel, all different.
std::unique_ptr<Driver> asciiSerialDriver(const SerialConfig& config, int channels);

/// Driver of a regulator on Modbus TCP, as its profile says.
///
/// Set points are rounded down to whole counts, within 0 and the highest count, so the requested
/// pressure is never exceeded. Slots without a used place are not written. In the other slots all
/// outlets are written, with 0 for outlets without a channel. vent() writes every register even if
/// the device does not answer. A register that reads kNoReading gives NaN; a reading below vacuum
/// is a BadReply.
///
/// In a device with apps, connect() acknowledges the faults of its slots and starts their apps at
/// set point 0. A slot closes if all its channels are to close; if only some are, those vent. A
/// slot that does not regulate within its activation time after the command is a LinkError:
/// reconnecting acknowledges its faults. Without a link running apps end, with the valves closed.
///
/// connect() takes at most the profile's timeout to resolve and again to reach the device (per
/// address, if the name has several), and twice its activation time. After any LinkError,
/// everything except vent() is refused until connect(). A reply that is late, cut short or garbled
/// to its end counts as a lost link; a complete but invalid reply is a BadReply. Orders that are
/// not one per channel, or not finite, throw std::invalid_argument.
///
/// @throws std::invalid_argument if the profile breaks its rules, or slots are missing, negative,
/// repeated, or beyond the last register.
std::unique_ptr<Driver> modbusTcpDriver(const ModbusConfig& config);

/// Prevents other programs on this machine from using a device while one drives it.
///
/// It is a socket with an abstract name (Linux). It leaves no file behind, applies to programs of
/// all users, and is released by the kernel when its holder dies, for any reason. Programs in
/// another network namespace (such as another container) and on other machines do not see it.
class DeviceLock {
 public:
  DeviceLock() = default;
  ~DeviceLock() { release(); }
  DeviceLock(const DeviceLock&) = delete;
  DeviceLock& operator=(const DeviceLock&) = delete;

  /// Locks the device with this name, of which the first 80 characters count. A device that is
  /// already held is released first, unless it is the same.
  /// @return nothing if it is held now, or if the system has no such sockets; otherwise its holder:
  /// "process 4711 (pressure_command)".
  std::optional<std::string> take(const std::string& device);
  void release() noexcept;

 private:
  int socket_ = -1;
  std::string device_;
};

}  // namespace helix_arm::regulator
