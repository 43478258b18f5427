#pragma once

#include <future>
#include <string>
#include <vector>

#include <sys/socket.h>

namespace helix_arm::regulator {

/// Opens TCP connections, each step of it within a time.
class TcpLink {
 public:
  /// @param host  name or address.
  TcpLink(std::string host, int port);

  /// A connected socket, the caller's to close; small messages leave it at once.
  ///
  /// @param timeout  for the name, and again for each of its addresses, at most three [s].
  /// @throws LinkError naming host, port, cause and remedy.
  int open(double timeout);

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

  std::string host_;
  std::string port_;
  std::string place_;
  /// Of a name server that takes its time; it is asked again once it has answered.
  std::shared_future<Resolved> pending_;
};

}  // namespace helix_arm::regulator
