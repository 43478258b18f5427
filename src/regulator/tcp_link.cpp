#include "tcp_link.hpp"

#include <algorithm>
#include <cerrno>
#include <chrono>
#include <cmath>
#include <cstring>
#include <memory>
#include <thread>
#include <utility>

#include <fcntl.h>
#include <netdb.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <poll.h>
#include <sys/select.h>
#include <sys/socket.h>
#include <unistd.h>

#include "helix_arm/regulator/driver.hpp"

namespace helix_arm::regulator {

namespace {

constexpr std::size_t kMostAddresses = 3;

// Returns 0 on success, otherwise errno.
int connectWithin(int socket, const sockaddr* address, socklen_t size, double timeout) {
  if (connect(socket, address, size) == 0) return 0;
  if (errno != EINPROGRESS) return errno;
  const auto end = std::chrono::steady_clock::now() + std::chrono::duration<double>(timeout);
  for (;;) {
    const double left =
        std::chrono::duration<double>(end - std::chrono::steady_clock::now()).count();
    pollfd waited{socket, POLLOUT, 0};
    const int ready = poll(&waited, 1, static_cast<int>(std::ceil(1e3 * std::max(left, 0.0))));
    if (ready == 0) return ETIMEDOUT;
    if (ready < 0 && errno == EINTR) continue;
    if (ready < 0) return errno;
    int error = 0;
    socklen_t error_size = sizeof error;
    getsockopt(socket, SOL_SOCKET, SO_ERROR, &error, &error_size);
    return error;
  }
}

const char* remedyOf(int error) {
  switch (error) {
    case ECONNREFUSED:
      return "check that its Modbus server runs, and on this port";
    case ETIMEDOUT:
    case EHOSTUNREACH:
    case ENETUNREACH:
      return "check that it is switched on, and on this network";
    default:
      return "check host, port and cable";
  }
}

}  // namespace

TcpLink::TcpLink(std::string host, int port)
    : host_(std::move(host)),
      port_(std::to_string(port)),
      place_((host_.find(':') == std::string::npos ? host_ : "[" + host_ + "]") + ":" + port_) {}

std::vector<TcpLink::Address> TcpLink::resolve(double timeout) {
  const auto look = [](const std::string& host, const std::string& port, int flags) {
    Resolved resolved;
    addrinfo hints{};
    hints.ai_socktype = SOCK_STREAM;
    hints.ai_flags = flags | AI_NUMERICSERV;
    addrinfo* found = nullptr;
    const int error = getaddrinfo(host.c_str(), port.c_str(), &hints, &found);
    if (error != 0) {
      resolved.error = error == EAI_SYSTEM ? std::strerror(errno) : gai_strerror(error);
      return resolved;
    }
    const std::unique_ptr<addrinfo, void (*)(addrinfo*)> owner(found, freeaddrinfo);
    for (const addrinfo* entry = found; entry != nullptr; entry = entry->ai_next) {
      Address address;
      address.size = std::min<socklen_t>(entry->ai_addrlen, sizeof address.storage);
      std::memcpy(&address.storage, entry->ai_addr, address.size);
      resolved.addresses.push_back(address);
    }
    return resolved;
  };
  Resolved resolved = look(host_, port_, AI_NUMERICHOST);
  if (resolved.error.empty()) return resolved.addresses;

  // The resolver has no adjustable timeout: it runs in a thread of its own that nothing waits for.
  if (!pending_.valid()) {
    auto promise = std::make_shared<std::promise<Resolved>>();
    pending_ = promise->get_future().share();
    std::thread([look, promise, host = host_, port = port_] {
      promise->set_value(look(host, port, 0));
    }).detach();
  }
  if (pending_.wait_for(std::chrono::duration<double>(timeout)) != std::future_status::ready) {
    throw LinkError(place_ +
                    ": no name server has answered yet; give an address such as "
                    "192.168.1.10 as host");
  }
  resolved = pending_.get();
  pending_ = {};
  if (!resolved.error.empty()) {
    throw LinkError(place_ + ": " + host_ + " is not known: " + resolved.error +
                    "; give an address such as 192.168.1.10 as host");
  }
  return resolved.addresses;
}

void TcpLink::claim(const Address& address) {
  char host[NI_MAXHOST] = "";
  getnameinfo(address.get(), address.size, host, sizeof host, nullptr, 0, NI_NUMERICHOST);
  const auto holder = lock_.take("modbus_tcp " + std::string(host) + " port " + port_);
  if (!holder || ignores_others_) return;
  throw LinkError(place_ + " is driven by " + *holder + "; end that one first");
}

int TcpLink::open(double timeout) {
  std::vector<Address> addresses = resolve(timeout);
  if (addresses.size() > kMostAddresses) addresses.resize(kMostAddresses);
  int error = EADDRNOTAVAIL;
  for (const Address& address : addresses) {
    claim(address);
    const int family = address.get()->sa_family;
    const int socket = ::socket(family, SOCK_STREAM | SOCK_NONBLOCK | SOCK_CLOEXEC, 0);
    if (socket < 0) {
      error = errno;
      continue;
    }
    // libmodbus waits with select(), which cannot handle larger descriptors.
    error =
        socket < FD_SETSIZE ? connectWithin(socket, address.get(), address.size, timeout) : EMFILE;
    if (error == 0) {
      const int on = 1;
      setsockopt(socket, IPPROTO_TCP, TCP_NODELAY, &on, sizeof on);
      return socket;
    }
    ::close(socket);
  }
  release();
  throw LinkError(place_ + ": cannot connect: " + std::strerror(error) + "; " + remedyOf(error));
}

}  // namespace helix_arm::regulator
