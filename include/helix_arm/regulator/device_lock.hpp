#pragma once

#include <optional>
#include <string>

namespace helix_arm::regulator {

/// Keeps the other programs of this machine off a device while one of them drives it.
///
/// It is a socket with an abstract name (Linux): no file is left behind, programs of all users meet
/// in it, and the kernel lets go of it when its holder dies, however it dies. Programs in another
/// network namespace, as in a container of its own, and on other machines do not see it.
class DeviceLock {
 public:
  DeviceLock() = default;
  ~DeviceLock() { release(); }
  DeviceLock(const DeviceLock&) = delete;
  DeviceLock& operator=(const DeviceLock&) = delete;

  /// Takes the device of this name, at most 80 characters of which count; one that is held is let
  /// go of first, unless it is the same.
  /// @return nothing once it is held, or where the system has no such sockets; else who holds it:
  /// "process 4711 (pressure_command)".
  std::optional<std::string> take(const std::string& device);
  void release() noexcept;

 private:
  int socket_ = -1;
  std::string device_;
};

}  // namespace helix_arm::regulator
