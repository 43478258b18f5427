#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <thread>
#include <utility>
#include <vector>

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

  explicit ReplyServer(Answer answer);
  ~ReplyServer();
  ReplyServer(const ReplyServer&) = delete;
  ReplyServer& operator=(const ReplyServer&) = delete;

  int port() const { return port_; }

 private:
  void run();

  Answer answer_;
  int listener_ = -1;
  int stop_ = -1;  // event counter
  int port_ = 0;
  std::thread thread_;
};

}  // namespace helix_arm::test
