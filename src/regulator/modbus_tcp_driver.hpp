#pragma once

#include <memory>
#include <optional>
#include <string>

#include "helix_arm/regulator/config.hpp"
#include "helix_arm/regulator/driver.hpp"

namespace helix_arm::regulator {

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

/// Driver of a regulator on Modbus TCP, as its profile says.
///
/// Set points are rounded down to whole counts, within 0 and the highest count, so the requested
/// pressure is never exceeded. Slots without a used place are not written. In the other slots all
/// outlets are written, with 0 for outlets without a channel.
///
/// In a device with apps, connect() acknowledges the faults of its slots and starts their apps at
/// set point 0. A slot closes if all its channels are to close; if only some are, those vent.
///
/// After any LinkError, everything except vent() is refused until connect(). A reply that is late,
/// cut short or garbled to its end counts as a lost link; a complete but invalid reply is a
/// BadReply.
class ModbusTcpDriver : public Driver {
 public:
  /// @throws std::invalid_argument if the profile breaks its rules, or slots are missing, negative,
  /// repeated, or beyond the last register.
  explicit ModbusTcpDriver(const ModbusConfig& config);

  /// Takes at most the profile's timeout to resolve and again to reach the device (per address, if
  /// the name has several), and twice its activation time.
  void connect() override { link_->connect(); }
  void ignoreOthers() noexcept override { link_->ignoreOthers(); }
  /// @throws std::invalid_argument if the orders are not one per channel, or not finite.
  void write(const control::ValveOrders& orders) override { link_->write(orders); }
  /// A register that reads kNoReading gives NaN; a reading below vacuum is a BadReply. A slot that
  /// does not regulate within its activation time after the command is a LinkError: reconnecting
  /// acknowledges its faults.
  void read(Pressures& pressures) override { link_->read(pressures); }
  /// Writes every register even if the device does not answer.
  void vent() override { link_->vent(); }
  /// Whether slots may be running apps: without a link these end, with the valves closed.
  bool keepsAirOnClose() const noexcept override { return link_->keepsAirOnClose(); }
  void close() noexcept override { link_->close(); }

 private:
  std::unique_ptr<Driver> link_;
};

}  // namespace helix_arm::regulator
