#include "helix_arm/basics/child_process.hpp"

#include <cerrno>
#include <chrono>
#include <csignal>
#include <system_error>
#include <thread>

#include <poll.h>
#include <spawn.h>
#include <sys/socket.h>
#include <sys/wait.h>
#include <unistd.h>

namespace helix_arm::basics {
namespace {

using Clock = std::chrono::steady_clock;

constexpr int kGrace = 1'000;                    // in which it may end by itself [ms]
constexpr std::chrono::milliseconds kPeriod(5);  // of looking whether it has ended

int spawn(const std::vector<std::string>& command, int end, pid_t& process) {
  posix_spawn_file_actions_t actions;
  posix_spawn_file_actions_init(&actions);
  posix_spawn_file_actions_adddup2(&actions, end, STDIN_FILENO);
  posix_spawn_file_actions_adddup2(&actions, end, STDOUT_FILENO);
#if __GLIBC_PREREQ(2, 34)
  posix_spawn_file_actions_addclosefrom_np(&actions, STDERR_FILENO + 1);
#endif
  sigset_t all, none;
  sigfillset(&all);
  sigemptyset(&none);
  posix_spawnattr_t attributes;
  posix_spawnattr_init(&attributes);
  posix_spawnattr_setsigdefault(&attributes, &all);
  posix_spawnattr_setsigmask(&attributes, &none);
  posix_spawnattr_setpgroup(&attributes, 0);
  posix_spawnattr_setflags(&attributes,
                           POSIX_SPAWN_SETSIGDEF | POSIX_SPAWN_SETSIGMASK | POSIX_SPAWN_SETPGROUP);
  std::vector<char*> arguments;
  arguments.reserve(command.size() + 1);
  for (const std::string& word : command) arguments.push_back(const_cast<char*>(word.c_str()));
  arguments.push_back(nullptr);
  const int error =
      posix_spawn(&process, arguments[0], &actions, &attributes, arguments.data(), environ);
  posix_spawnattr_destroy(&attributes);
  posix_spawn_file_actions_destroy(&actions);
  return error;
}

}  // namespace

ChildProcess::ChildProcess(const std::vector<std::string>& command) {
  int ends[2];
  if (socketpair(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0, ends) != 0) {
    throw std::system_error(errno, std::generic_category());
  }
  const int error = spawn(command, ends[1], process_);
  ::close(ends[1]);
  socket_ = ends[0];
  if (error == 0) return;
  ::close(socket_);
  throw std::system_error(error, std::generic_category());
}

ChildProcess::~ChildProcess() {
  ::close(socket_);
  const bool ended = status(kGrace).has_value();
  kill();
  if (!ended) {
    while (waitpid(process_, nullptr, 0) < 0 && errno == EINTR) continue;
  }
}

bool ChildProcess::send(const std::string& text) {
  for (std::size_t sent = 0; sent < text.size();) {
    const ssize_t count = ::send(socket_, text.data() + sent, text.size() - sent, MSG_NOSIGNAL);
    if (count < 0 && errno == EINTR) continue;
    if (count <= 0) return false;
    sent += static_cast<std::size_t>(count);
  }
  return true;
}

std::optional<std::size_t> ChildProcess::read(void* bytes, std::size_t size, int patience) {
  const auto end = Clock::now() + std::chrono::milliseconds(patience);
  for (;;) {
    const auto left = std::chrono::ceil<std::chrono::milliseconds>(end - Clock::now()).count();
    if (left <= 0) return std::nullopt;
    pollfd waited{socket_, POLLIN, 0};
    const int ready = poll(&waited, 1, static_cast<int>(left));
    if (ready == 0) return std::nullopt;
    const ssize_t count = ready < 0 ? -1 : ::read(socket_, bytes, size);
    if (count < 0 && errno == EINTR) continue;
    return count < 0 ? 0 : static_cast<std::size_t>(count);
  }
}

void ChildProcess::kill() { ::kill(-process_, SIGKILL); }

std::optional<int> ChildProcess::status(int patience) {
  const auto end = Clock::now() + std::chrono::milliseconds(patience);
  while (!status_) {
    int status = 0;
    const pid_t ended = waitpid(process_, &status, WNOHANG);
    if (ended == process_) {
      status_ = status;
    } else if (ended < 0 || Clock::now() >= end) {
      break;
    } else {
      std::this_thread::sleep_for(kPeriod);
    }
  }
  return status_;
}

}  // namespace helix_arm::basics
