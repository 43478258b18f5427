#include "helix_arm/regulator/device_lock.hpp"

#include <algorithm>
#include <cerrno>
#include <cstddef>
#include <fstream>

#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

#include "helix_arm/basics/quote.hpp"

namespace helix_arm::regulator {
namespace {

constexpr char kPrefix[] = "helix_arm regulator ";
constexpr std::size_t kLongestName = 80;

struct Name {
  sockaddr_un address{};
  socklen_t size = 0;

  explicit Name(const std::string& device) {
    const std::string text = kPrefix + device.substr(0, kLongestName);
    static_assert(sizeof kPrefix + kLongestName < sizeof address.sun_path);
    address.sun_family = AF_UNIX;
    std::copy(text.begin(), text.end(), address.sun_path + 1);  // after a 0: an abstract socket
    size = static_cast<socklen_t>(offsetof(sockaddr_un, sun_path) + 1 + text.size());
  }
  const sockaddr* get() const { return reinterpret_cast<const sockaddr*>(&address); }
};

int makeSocket() { return socket(AF_UNIX, SOCK_STREAM | SOCK_NONBLOCK | SOCK_CLOEXEC, 0); }

// Describes the process that listens on the socket.
std::string holderOf(const Name& name) {
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

}  // namespace

std::optional<std::string> DeviceLock::take(const std::string& device) {
  if (socket_ >= 0 && device == device_) return std::nullopt;
  release();
  const Name name(device);
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

}  // namespace helix_arm::regulator
