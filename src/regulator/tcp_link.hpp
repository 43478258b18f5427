#pragma once

#include <future>
#include <string>
#include <vector>

#include <sys/socket.h>

#include "helix_arm/regulator/device_lock.hpp"

namespace helix_arm::regulator {

/// Opens TCP connections, each step of it within a time, to a device that one program of this
/// machine drives at a time.
class TcpLink {
 public:
  /// @param host  name or address.
  TcpLink(std::string host, int port);

  /// A connected socket, the caller's to close; small messages leave it at once. The device is this
  /// program's until release().
  ///
  /// @param timeout  for the name, and again for each of its addresses, at most three [s].
  /// @throws LinkError naming host, port, cause and remedy, and who drives the device already.
  int open(double timeout);
  /// Lets other programs drive the device.
  void release() noexcept { lock_.release(); }
  /// From now on open() connects whoever drives the device.
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
  /// @throws LinkError where another program drives the device at this address.
  void claim(const Address& address);

  std::string host_;
  std::string port_;
  std::string place_;
  DeviceLock lock_;
  bool ignores_others_ = false;
  /// Of a name server that takes its time; it is asked again once it has answered.
  std::shared_future<Resolved> pending_;
};

}  // namespace helix_arm::regulator
