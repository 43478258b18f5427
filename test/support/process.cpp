#include "support/process.hpp"

#include <algorithm>
#include <cerrno>
#include <chrono>
#include <csignal>
#include <cstdlib>
#include <cstring>
#include <stdexcept>

#include <fcntl.h>
#include <netinet/in.h>
#include <poll.h>
#include <sys/prctl.h>
#include <sys/socket.h>
#include <sys/wait.h>
#include <unistd.h>

namespace helix_arm::test {
namespace {

using Clock = std::chrono::steady_clock;

double secondsUntil(Clock::time_point end) {
  return std::chrono::duration<double>(end - Clock::now()).count();
}

Clock::time_point in(double seconds) {
  return Clock::now() +
         std::chrono::duration_cast<Clock::duration>(std::chrono::duration<double>(seconds));
}

sockaddr_in localhost(int port) {
  sockaddr_in address{};
  address.sin_family = AF_INET;
  address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  address.sin_port = htons(static_cast<std::uint16_t>(port));
  return address;
}

bool accepts(int port) {
  const int socket = ::socket(AF_INET, SOCK_STREAM, 0);
  const sockaddr_in address = localhost(port);
  const bool connected =
      connect(socket, reinterpret_cast<const sockaddr*>(&address), sizeof address) == 0;
  close(socket);
  return connected;
}

}  // namespace

Process::Process(const std::vector<std::string>& command, const Variables& variables) {
  int ends[2], input[2];
  if (pipe2(ends, O_CLOEXEC) != 0 || pipe2(input, O_CLOEXEC) != 0) {
    throw std::runtime_error("no pipe for " + command.front());
  }
  std::vector<char*> arguments;
  for (const std::string& argument : command)
    arguments.push_back(const_cast<char*>(argument.c_str()));
  arguments.push_back(nullptr);
  const pid_t parent = getpid();
  pid_ = fork();
  if (pid_ < 0) throw std::runtime_error("cannot fork for " + command.front());
  if (pid_ == 0) {
    setpgid(0, 0);
    // Asked to end, not killed: a roslaunch has nodes to end in turn.
    prctl(PR_SET_PDEATHSIG, SIGTERM);
    if (getppid() != parent) _exit(1);
    for (const auto& [name, value] : variables) setenv(name.c_str(), value.c_str(), 1);
    dup2(input[0], STDIN_FILENO);
    dup2(ends[1], STDOUT_FILENO);
    dup2(ends[1], STDERR_FILENO);
    execvp(arguments.front(), arguments.data());
    dprintf(STDERR_FILENO, "cannot run %s: %s\n", arguments.front(), std::strerror(errno));
    _exit(127);
  }
  setpgid(pid_, pid_);  // in both processes: whoever comes first
  close(input[0]);
  close(ends[1]);
  input_ = input[1];
  pipe_ = ends[0];
}

Process::~Process() {
  if (exit_code_ < 0) {
    signal(SIGINT);
    if (exitCode(10.0) < 0) signal(SIGKILL);
    exitCode(10.0);
  }
  signal(SIGKILL);  // grandchildren, if any are left
  endInput();
  close(pipe_);
}

void Process::say(const std::string& text) const {
  if (write(input_, text.data(), text.size()) != static_cast<ssize_t>(text.size())) {
    throw std::runtime_error("it does not read: " + text);
  }
}

void Process::endInput() {
  if (input_ >= 0) close(input_);
  input_ = -1;
}

void Process::signal(int number) const { kill(-pid_, number); }

bool Process::read(double seconds) {
  pollfd ready{pipe_, POLLIN, 0};
  if (poll(&ready, 1, std::max(0, static_cast<int>(1e3 * seconds))) <= 0) return true;
  char buffer[4096];
  const ssize_t size = ::read(pipe_, buffer, sizeof buffer);
  if (size > 0) output_.append(buffer, size);
  return size > 0;
}

void Process::drain() {
  pollfd more{pipe_, POLLIN, 0};
  while (poll(&more, 1, 0) > 0 && read(0.0)) {
  }
}

const std::string& Process::outputNow() {
  drain();
  return output_;
}

bool Process::prints(const std::string& text, double deadline) {
  const auto end = in(deadline);
  while (output_.find(text) == std::string::npos) {
    if (secondsUntil(end) <= 0 || !read(secondsUntil(end))) break;
  }
  return output_.find(text) != std::string::npos;
}

int Process::exitCode(double deadline) {
  const auto end = in(deadline);
  while (exit_code_ < 0) {
    int status = 0;
    const bool ended = waitpid(pid_, &status, WNOHANG) == pid_;
    read(ended ? 0.0 : 0.02);
    drain();
    if (ended) exit_code_ = WIFEXITED(status) ? WEXITSTATUS(status) : 128 + WTERMSIG(status);
    if (secondsUntil(end) <= 0) break;
  }
  return exit_code_;
}

int freePort() {
  const int socket = ::socket(AF_INET, SOCK_STREAM, 0);
  sockaddr_in address = localhost(0);
  socklen_t size = sizeof address;
  if (bind(socket, reinterpret_cast<sockaddr*>(&address), size) != 0 ||
      getsockname(socket, reinterpret_cast<sockaddr*>(&address), &size) != 0) {
    throw std::runtime_error("no free port");
  }
  close(socket);
  return ntohs(address.sin_port);
}

Master::Master() : port_(freePort()) { start(); }

void Master::start() {
  process_ = std::make_unique<Process>(
      std::vector<std::string>{"rosmaster", "--core", "-p", std::to_string(port_)}, variables());
  const auto end = in(30.0);
  while (!accepts(port_)) {
    if (secondsUntil(end) <= 0) throw std::runtime_error("no master:\n" + process_->output());
    usleep(20000);
  }
}

Process::Variables Master::variables() const {
  return {{"ROS_MASTER_URI", "http://localhost:" + std::to_string(port_)},
          {"ROS_HOSTNAME", "localhost"}};
}

}  // namespace helix_arm::test
