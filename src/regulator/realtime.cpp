#include "realtime.hpp"

#include <cerrno>
#include <cstring>
#include <fstream>
#include <thread>

#include <sched.h>
#include <sys/mman.h>
#include <sys/resource.h>

namespace helix_arm::regulator {
namespace {

constexpr int kIpcLock = 14;  // CAP_IPC_LOCK of linux/capability.h

bool has(int capability) {
  std::ifstream status("/proc/self/status");
  for (std::string word; status >> word;) {
    if (word != "CapEff:") continue;
    unsigned long long effective = 0;
    status >> std::hex >> effective;
    return (effective >> capability & 1) != 0;
  }
  return false;
}

std::string remedy(const char* limit, const std::string& value) {
  return "; to allow it put `@realtime - " + std::string(limit) + " " + value +
         "` in /etc/security/limits.conf, add the user to the group realtime and log in again";
}

}  // namespace

std::string scheduleRealtime(int priority) {
  if (priority == 0) return {};
  sched_param parameter{};
  parameter.sched_priority = priority;
  const int error =
      pthread_setschedparam(pthread_self(), SCHED_FIFO | SCHED_RESET_ON_FORK, &parameter);
  if (error == 0) return {};
  return "real-time priority " + std::to_string(priority) + " is refused (" + std::strerror(error) +
         ")" + remedy("rtprio", std::to_string(priority));
}

std::string tryRealtime(int priority) {
  std::string refusal;
  std::thread([&] { refusal = scheduleRealtime(priority); }).join();
  return refusal;
}

std::string lockMemory() {
  // Below a limit, mlockall() would succeed and later allocations would fail.
  rlimit limit{};
  const bool any = getrlimit(RLIMIT_MEMLOCK, &limit) == 0 && limit.rlim_cur == RLIM_INFINITY;
  int error = EPERM;
  if (any || has(kIpcLock)) {
    // Pages are locked when first used, since stacks of threads are large and mostly unused.
    error = mlockall(MCL_CURRENT | MCL_FUTURE | MCL_ONFAULT) == 0 ? 0 : errno;
  }
  if (error == 0) return {};
  return "locked memory is refused (" + std::string(std::strerror(error)) + ")" +
         remedy("memlock", "unlimited");
}

}  // namespace helix_arm::regulator
