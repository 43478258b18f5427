#pragma once

#include <optional>
#include <string>

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

}  // namespace helix_arm::regulator
