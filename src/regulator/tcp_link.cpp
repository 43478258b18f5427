#include "tcp_link.hpp"

#include <cerrno>
#include <chrono>
#include <cmath>
#include <cstddef>
#include <fstream>
#include <memory>
#include <thread>

#include <netdb.h>
#include <netinet/tcp.h>
#include <poll.h>
#include <sys/select.h>
#include <sys/un.h>
#include <unistd.h>

#include "basics/quote.hpp"
#include "helix_arm/regulator/config.hpp"
#include "regulator_io.hpp"

namespace helix_arm::regulator {
namespace {

constexpr char kPrefix[] = "helix_arm regulator ";
constexpr std::size_t kLongestName = 80;

SocketAddress lockOf(const std::string& device) {
  const std::string text = kPrefix + device.substr(0, kLongestName);
  sockaddr_un address{};
  static_assert(sizeof kPrefix + kLongestName < sizeof address.sun_path);
  address.sun_family = AF_UNIX;
  std::copy(text.begin(), text.end(), address.sun_path + 1);  // after a 0: an abstract socket
  return {&address, offsetof(sockaddr_un, sun_path) + 1 + text.size()};
}

int makeSocket() { return socket(AF_UNIX, SOCK_STREAM | SOCK_NONBLOCK | SOCK_CLOEXEC, 0); }

// Describes the process that listens on the socket.
std::string holderOf(const SocketAddress& name) {
  const int caller = makeSocket();
  ucred holder{};
  socklen_t size = sizeof holder;
  // A full backlog refuses the call, and the holder may just have ended.
  const bool told = caller >= 0 && connect(caller, name.get(), name.size) == 0 &&
                    getsockopt(caller, SOL_SOCKET, SO_PEERCRED, &holder, &size) == 0 &&
                    holder.pid > 0;
  if (caller >= 0) ::close(caller);
  if (!told) return "another program";
  std::string program;
  std::ifstream command("/proc/" + std::to_string(holder.pid) + "/cmdline");
  std::getline(command, program, '\0');
  program.erase(0, program.rfind('/') + 1);  // npos + 1 is 0
  return "process " + std::to_string(holder.pid) +
         (program.empty() ? "" : " (" + basics::quoted(program) + ")");
}

constexpr std::size_t kMostAddresses = 3;

// Returns 0 on success, otherwise errno.
int connectWithin(int socket, const SocketAddress& address, double timeout) {
  if (connect(socket, address.get(), address.size) == 0) return 0;
  if (errno != EINPROGRESS) return errno;
  const double end = steadyNow() + timeout;
  for (;;) {
    const double left = std::max(end - steadyNow(), 0.0);
    pollfd waited{socket, POLLOUT, 0};
    const int ready = poll(&waited, 1, static_cast<int>(std::ceil(1e3 * left)));
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

std::optional<std::string> DeviceLock::take(const std::string& device) {
  if (socket_ >= 0 && device == device_) return std::nullopt;
  release();
  const SocketAddress name = lockOf(device);
  const int mine = makeSocket();
  if (mine < 0) return std::nullopt;  // the device's own socket will fail, too
  if (bind(mine, name.get(), name.size) != 0) {
    const bool taken = errno == EADDRINUSE;
    ::close(mine);
    return taken ? std::optional(holderOf(name)) : std::nullopt;
  }
  listen(mine, SOMAXCONN);  // lets callers find the holder; no call is answered
  socket_ = mine;
  device_ = device;
  return std::nullopt;
}

void DeviceLock::release() noexcept {
  if (socket_ >= 0) ::close(socket_);
  socket_ = -1;
}

TcpLink::TcpLink(std::string host, int port)
    : host_(std::move(host)),
      port_(std::to_string(port)),
      place_((host_.find(':') == std::string::npos ? host_ : "[" + host_ + "]") + ":" + port_) {}

int TcpLink::open(double timeout) {
  const std::vector<SocketAddress> addresses = resolve(timeout);
  const std::size_t most = std::min(addresses.size(), kMostAddresses);
  int error = EADDRNOTAVAIL;
  for (std::size_t i = 0; i < most; ++i) {
    const SocketAddress& address = addresses[i];
    claim(address);
    const int socket =
        ::socket(address.storage.ss_family, SOCK_STREAM | SOCK_NONBLOCK | SOCK_CLOEXEC, 0);
    if (socket < 0) {
      error = errno;
      continue;
    }
    // libmodbus waits with select(), which cannot handle larger descriptors.
    error = socket < FD_SETSIZE ? connectWithin(socket, address, timeout) : EMFILE;
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

std::vector<SocketAddress> TcpLink::resolve(double timeout) {
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
      resolved.addresses.emplace_back(entry->ai_addr, entry->ai_addrlen);
    }
    return resolved;
  };
  Resolved resolved = look(host_, port_, AI_NUMERICHOST);
  if (resolved.error.empty()) return resolved.addresses;

  // The resolver has no adjustable timeout: it runs in a thread that nothing waits for.
  if (!pending_.valid()) {
    auto promise = std::make_shared<std::promise<Resolved>>();
    pending_ = promise->get_future().share();
    std::thread([look, promise, host = host_, port = port_] {
      promise->set_value(look(host, port, 0));
    }).detach();
  }
  if (pending_.wait_for(std::chrono::duration<double>(timeout)) != std::future_status::ready) {
    throw LinkError(
        place_ + ": no name server has answered yet; give an address such as 192.168.1.10 as host");
  }
  resolved = pending_.get();
  pending_ = {};
  if (!resolved.error.empty()) {
    throw LinkError(place_ + ": " + host_ + " is not known: " + resolved.error +
                    "; give an address such as 192.168.1.10 as host");
  }
  return resolved.addresses;
}

void TcpLink::claim(const SocketAddress& address) {
  char host[NI_MAXHOST] = "";
  getnameinfo(address.get(), address.size, host, sizeof host, nullptr, 0, NI_NUMERICHOST);
  // The kind of regulator, by which programs find that they drive the same device.
  const auto holder = lock_.take(std::string(ModbusConfig::kKind) + " " + host + " port " + port_);
  if (!holder || ignores_others_) return;
  throw LinkError(place_ + " is driven by " + *holder + "; end that one first");
}

}  // namespace helix_arm::regulator
