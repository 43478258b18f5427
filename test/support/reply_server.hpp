#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <stdexcept>
#include <thread>
#include <utility>
#include <vector>

#include <netinet/in.h>
#include <poll.h>
#include <sys/eventfd.h>
#include <sys/socket.h>
#include <unistd.h>

namespace helix_arm::test {

/// A TCP server on 127.0.0.1 that answers every request of one connection after the other with the
/// bytes that a function gives; without any where it gives none.
class ReplyServer {
 public:
  using Bytes = std::vector<std::uint8_t>;
  struct Reply {
    Reply(Bytes said, bool last = false) : bytes(std::move(said)), hangs_up(last) {}

    Bytes bytes;
    bool hangs_up;  ///< after them
  };
  using Answer = std::function<Reply(const Bytes& request)>;

  explicit ReplyServer(Answer answer) : answer_(std::move(answer)) {
    listener_ = socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
    stop_ = eventfd(0, EFD_CLOEXEC);
    sockaddr_in address{};
    address.sin_family = AF_INET;
    address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    socklen_t size = sizeof address;
    auto* const generic = reinterpret_cast<sockaddr*>(&address);
    if (listener_ < 0 || stop_ < 0 || bind(listener_, generic, size) != 0 ||
        listen(listener_, 8) != 0 || getsockname(listener_, generic, &size) != 0) {
      throw std::runtime_error("no server to reply");
    }
    port_ = ntohs(address.sin_port);
    thread_ = std::thread([this] { run(); });
  }
  ~ReplyServer() {
    eventfd_write(stop_, 1);
    thread_.join();
    close(listener_);
    close(stop_);
  }
  ReplyServer(const ReplyServer&) = delete;
  ReplyServer& operator=(const ReplyServer&) = delete;

  int port() const { return port_; }

 private:
  void run() {
    int client = -1;
    for (;;) {
      pollfd waited[] = {{stop_, POLLIN, 0}, {client < 0 ? listener_ : client, POLLIN, 0}};
      if (poll(waited, 2, -1) < 0 || waited[0].revents != 0) break;
      if (client < 0) {
        client = accept4(listener_, nullptr, nullptr, SOCK_CLOEXEC);
        continue;
      }
      Bytes request(512);
      const ssize_t got = recv(client, request.data(), request.size(), 0);
      if (got <= 0) {
        close(client);
        client = -1;
        continue;
      }
      request.resize(static_cast<std::size_t>(got));
      const auto [said, hangs_up] = answer_(request);
      if (!said.empty()) send(client, said.data(), said.size(), MSG_NOSIGNAL);
      if (hangs_up) {
        close(client);
        client = -1;
      }
    }
    if (client >= 0) close(client);
  }

  Answer answer_;
  int listener_ = -1;
  int stop_ = -1;  // event counter
  int port_ = 0;
  std::thread thread_;
};

}  // namespace helix_arm::test
