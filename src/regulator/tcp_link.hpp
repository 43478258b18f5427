#pragma once

#include <algorithm>
#include <cstring>
#include <future>
#include <optional>
#include <string>
#include <vector>

#include <sys/socket.h>

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

struct SocketAddress {
  SocketAddress(const void* address, std::size_t length)
      : size(static_cast<socklen_t>(std::min(length, sizeof storage))) {
    std::memcpy(&storage, address, size);
  }
  const sockaddr* get() const { return reinterpret_cast<const sockaddr*>(&storage); }

  sockaddr_storage storage{};
  socklen_t size;
};

/// Opens TCP connections, with timeouts, to a device that one program of this machine drives.
class TcpLink {
 public:
  /// @param host  name or address of a Modbus server.
  TcpLink(std::string host, int port);

  /// Returns a connected socket, without delay of small messages, which the caller closes. The
  /// device is locked until release().
  ///
  /// @param timeout  for resolving the name, and again for each of at most three addresses [s].
  /// @throws LinkError naming host, port, cause and remedy, or the program that drives the device.
  int open(double timeout);

  /// Unlocks the device for other programs.
  void release() noexcept { lock_.release(); }
  /// Makes open() connect even if another program drives the device.
  void ignoreOthers() noexcept { ignores_others_ = true; }

  /// "host:port".
  const std::string& place() const { return place_; }

 private:
  struct Resolved {
    std::vector<SocketAddress> addresses;
    std::string error;
  };

  std::vector<SocketAddress> resolve(double timeout);
  /// @throws LinkError if another program drives the device at this address.
  void claim(const SocketAddress& address);

  std::string host_, port_, place_;
  DeviceLock lock_;
  bool ignores_others_ = false;
  /// Pending answer of a slow name server; a new request is made only after it.
  std::shared_future<Resolved> pending_;
};

}  // namespace helix_arm::regulator
