#include "two_networks.hpp"

#include <cerrno>
#include <csignal>
#include <cstring>

#include <fcntl.h>
#include <sched.h>
#include <sys/prctl.h>
#include <sys/wait.h>
#include <unistd.h>

#include "support/process.hpp"

namespace helix_arm::test {
namespace {

constexpr int kNotFound = 127;  // exit code

void run(const std::vector<std::string>& command) {
  Process process(command);
  const int code = process.exitCode();
  if (code == 0) return;
  std::string text;
  for (const std::string& word : command) text += word + " ";
  text += "failed: " + process.output();
  if (code == kNotFound) throw NoNetworks(text);
  throw std::runtime_error(text);
}

// The life of a child that holds a namespace: it says how making it went, and waits for its end.
[[noreturn]] void hold(int report, pid_t parent) {
  prctl(PR_SET_PDEATHSIG, SIGKILL);
  const int error = unshare(CLONE_NEWNET) == 0 ? 0 : errno;
  const bool said = write(report, &error, sizeof error) == sizeof error;
  close(report);
  while (said && error == 0 && getppid() == parent) pause();
  _exit(0);
}

}  // namespace

NetworkNamespace::NetworkNamespace() {
  int ends[2];
  if (pipe2(ends, O_CLOEXEC) != 0) throw std::runtime_error("no pipe for a network namespace");
  const pid_t parent = getpid();
  child_ = fork();
  if (child_ == 0) hold(ends[1], parent);
  close(ends[1]);
  int error = child_ < 0 ? errno : ECHILD;
  if (child_ > 0 && read(ends[0], &error, sizeof error) != sizeof error) error = ECHILD;
  close(ends[0]);
  if (error == 0) return;
  if (child_ > 0) waitpid(child_, nullptr, 0);
  const std::string text = std::string("no network namespace: ") + std::strerror(error);
  if (error == EPERM || error == EACCES) throw NoNetworks(text);
  throw std::runtime_error(text);
}

NetworkNamespace::~NetworkNamespace() {
  kill(child_, SIGKILL);
  waitpid(child_, nullptr, 0);
}

std::vector<std::string> NetworkNamespace::inside(const std::vector<std::string>& command) const {
  std::vector<std::string> all = {"nsenter", "--target=" + id(), "--net"};
  all.insert(all.end(), command.begin(), command.end());
  return all;
}

void NetworkNamespace::enter() const {
  const std::string path = "/proc/" + id() + "/ns/net";
  const int file = open(path.c_str(), O_RDONLY | O_CLOEXEC);
  const bool entered = file >= 0 && setns(file, CLONE_NEWNET) == 0;
  const int error = errno;
  if (file >= 0) close(file);
  if (!entered) throw std::runtime_error(path + " cannot be entered: " + std::strerror(error));
}

TwoNetworks::TwoNetworks() {
  run(switch_.inside({"ip", "link", "add", "bridge", "type", "bridge"}));
  run(switch_.inside({"ip", "link", "set", "bridge", "up"}));
  connect("control", control_, kControl);
  connect("camera", camera_, kCamera);
}

void TwoNetworks::connect(const char* port, const NetworkNamespace& machine,
                          const char* address) const {
  run(switch_.inside(
      {"ip", "link", "add", port, "type", "veth", "peer", "name", "eth0", "netns", machine.id()}));
  run(switch_.inside({"ip", "link", "set", port, "master", "bridge"}));
  run(switch_.inside({"ip", "link", "set", port, "up"}));
  run(machine.inside({"ip", "address", "add", std::string(address) + "/24", "dev", "eth0"}));
  for (const char* device : {"lo", "eth0"}) {
    run(machine.inside({"ip", "link", "set", device, "up"}));
  }
}

void TwoNetworks::cut() const { run(switch_.inside({"ip", "link", "set", "camera", "down"})); }

void TwoNetworks::heal() const { run(switch_.inside({"ip", "link", "set", "camera", "up"})); }

}  // namespace helix_arm::test
