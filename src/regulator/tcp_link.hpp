#pragma once

#include <future>
#include <string>
#include <vector>

#include <sys/socket.h>

#include "helix_arm/regulator/device_lock.hpp"

namespace helix_arm::regulator {

/// Opens TCP connections with timeouts to a device that one program on this machine drives at a
/// time.
class TcpLink {
 public:
  /// @param host  name or address.
  TcpLink(std::string host, int port);

  /// Returns a connected socket, without delay of small messages, which the caller closes. The
  /// device is locked until release().
  ///
  /// @param timeout  for resolving the name, and again for each of at most three addresses [s].
  /// @throws LinkError naming host, port, cause and remedy, and the program that already drives the
  /// device.
  int open(double timeout);
  /// Unlocks the device for other programs.
  void release() noexcept { lock_.release(); }
  /// Makes open() connect even if another program drives the device.
  void ignoreOthers() noexcept { ignores_others_ = true; }

  /// "host:port".
  const std::string& place() const { return place_; }

 private:
  struct Address {
    sockaddr_storage storage{};
    socklen_t size = 0;

    const sockaddr* get() const { return reinterpret_cast<const sockaddr*>(&storage); }
  };
  struct Resolved {
    std::vector<Address> addresses;
    std::string error;
  };

  std::vector<Address> resolve(double timeout);
  /// @throws LinkError if another program drives the device at this address.
  void claim(const Address& address);

  std::string host_;
  std::string port_;
  std::string place_;
  DeviceLock lock_;
  bool ignores_others_ = false;
  /// Pending answer of a slow name server; a new request is made only after it.
  std::shared_future<Resolved> pending_;
};

}  // namespace helix_arm::regulator
