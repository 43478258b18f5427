#include "two_networks.hpp"

#include <cerrno>
#include <cstring>
#include <stdexcept>

#include <fcntl.h>
#include <sched.h>
#include <unistd.h>

#include "support/process.hpp"

namespace helix_arm::test {
namespace {

constexpr const char* kMachines[] = {"switch", "control", "camera"};

void run(const std::vector<std::string>& command) {
  Process process(command);
  if (process.exitCode() == 0) return;
  std::string text;
  for (const std::string& word : command) text += word + " ";
  throw std::runtime_error(text + "failed: " + process.output());
}

}  // namespace

TwoNetworks::TwoNetworks() {
  try {
    for (const char* machine : kMachines) run({"ip", "netns", "add", name(machine)});
    const std::string hub = name("switch");
    run({"ip", "-n", hub, "link", "add", "bridge", "type", "bridge"});
    run({"ip", "-n", hub, "link", "set", "bridge", "up"});
    for (const std::string machine : {"control", "camera"}) {
      run({"ip", "-n", hub, "link", "add", machine, "type", "veth", "peer", "name", "eth0", "netns",
           name(machine)});
      run({"ip", "-n", hub, "link", "set", machine, "master", "bridge"});
      run({"ip", "-n", hub, "link", "set", machine, "up"});
      const std::string address = machine == "control" ? kControl : kCamera;
      run({"ip", "-n", name(machine), "address", "add", address + "/24", "dev", "eth0"});
      for (const char* device : {"lo", "eth0"}) {
        run({"ip", "-n", name(machine), "link", "set", device, "up"});
      }
    }
  } catch (...) {
    remove();
    throw;
  }
}

TwoNetworks::~TwoNetworks() { remove(); }

void TwoNetworks::enterControl() const {
  const std::string path = "/run/netns/" + name("control");
  const int file = open(path.c_str(), O_RDONLY | O_CLOEXEC);
  const bool entered = file >= 0 && setns(file, CLONE_NEWNET) == 0;
  const int error = errno;
  if (file >= 0) close(file);
  if (!entered) throw std::runtime_error(path + " cannot be entered: " + std::strerror(error));
}

std::vector<std::string> TwoNetworks::onCamera(const std::vector<std::string>& command) const {
  std::vector<std::string> all = {"ip", "netns", "exec", name("camera")};
  all.insert(all.end(), command.begin(), command.end());
  return all;
}

void TwoNetworks::cut() const {
  run({"ip", "-n", name("switch"), "link", "set", "camera", "down"});
}

void TwoNetworks::heal() const { run({"ip", "-n", name("switch"), "link", "set", "camera", "up"}); }

std::string TwoNetworks::name(const std::string& machine) const {
  return "helix_arm_" + std::to_string(getpid()) + "_" + machine;
}

void TwoNetworks::remove() const {
  for (const char* machine : kMachines)
    Process({"ip", "netns", "delete", name(machine)}).exitCode();
}

}  // namespace helix_arm::test
