#include <cerrno>
#include <chrono>
#include <csignal>
#include <cstring>
#include <iostream>
#include <sstream>
#include <thread>

#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include "helix_arm/regulator/guard_process.hpp"
#include "helix_arm/regulator/realtime.hpp"
#include "helix_arm/regulator/regulator_io.hpp"
#include "regulator_actions.hpp"

namespace helix_arm::cli {
namespace {

using regulator::steadyNow;

constexpr double kTrying = 10;  // [s]
constexpr std::chrono::milliseconds kBetweenTries(50);

// How the process that moves the arm (the ward) ended.
enum class End { kDismissesGuard, kIsGone, kStandsStill };

// Reads and answers stdin until then. Counts whole periods without a beat rather than time, so that
// a machine that was suspended has lost only one period.
End awaitEnd() {
  using regulator::GuardProcess;
  constexpr int kBeatMs = static_cast<int>(1e3 * GuardProcess::kBeatPeriod);
  bool beats = false;
  int missed = 0;
  for (;;) {
    pollfd waited{STDIN_FILENO, POLLIN, 0};
    const int ready = poll(&waited, 1, beats ? kBeatMs : -1);
    if (ready == 0 && ++missed == GuardProcess::kMissedBeats) return End::kStandsStill;
    if (ready <= 0) continue;
    char bytes[64];
    const ssize_t size = read(STDIN_FILENO, bytes, sizeof bytes);
    if (size < 0 && errno == EINTR) continue;
    if (size <= 0) return End::kIsGone;
    // The answer is only for a ward behind a socket that reads it.
    send(STDIN_FILENO, bytes, static_cast<std::size_t>(size), MSG_NOSIGNAL | MSG_DONTWAIT);
    if (std::memchr(bytes, GuardProcess::kDismissal, static_cast<std::size_t>(size)) != nullptr) {
      return End::kDismissesGuard;
    }
    beats = true;
    missed = 0;
  }
}

// The ward must neither keep the line nor wake up and move the arm.
void endWard() {
  ucred ward{};
  socklen_t size = sizeof ward;
  if (getsockopt(STDIN_FILENO, SOL_SOCKET, SO_PEERCRED, &ward, &size) == 0) kill(ward.pid, SIGKILL);
}

// Connects and vents, for at most kTrying.
Vented vent(regulator::Driver& driver, const io::Scene& scene) {
  const double end = steadyNow() + kTrying;
  for (;;) {
    Vented result;
    try {
      driver.connect();
      result = ventAll(driver, scene);
    } catch (const regulator::LinkError& error) {
      result.reason = error.what();
    }
    if (result.reason.empty() || steadyNow() >= end) return result;
    std::this_thread::sleep_for(kBetweenTries);
  }
}

}  // namespace

int guardRegulator(const RegulatorOptions& options, const GlobalOptions& global) {
  for (const int number : {SIGINT, SIGTERM, SIGHUP, SIGPIPE}) std::signal(number, SIG_IGN);
  const io::Scene scene = loadRegulatedScene(options, global);
  const auto driver = makeDriver(scene);  // early, so that a fault shows before it is needed
  driver->ignoreOthers();  // the ward may still be exiting and hold the lock of the device
  // After the slow preparations. A refusal is not printed here: the node that started the guard
  // prints its own.
  regulator::scheduleRealtime(options.realtime_priority);
  if (options.realtime_priority > 0) regulator::lockMemory();
  const End end = awaitEnd();
  if (end == End::kDismissesGuard) return kDone;
  if (end == End::kStandsStill) endWard();
  const double begin = steadyNow();
  const Vented result = vent(*driver, scene);
  std::ostringstream line;
  line << "guard: the process that moved the arm "
       << (end == End::kStandsStill ? "did not respond and was killed; "
                                    : "ended without venting it; ")
       << regulator::describe(*scene.regulator);
  if (result.reason.empty()) {
    line << " is vented, after " << steadyNow() - begin << " s\n";
  } else {
    line << " is NOT vented: " << result.reason
         << "; the arm may be under pressure: shut the supply, open the relief valve by hand, then "
            "`helix_arm regulator "
         << options.scene << " vent`\n";
  }
  std::cerr << line.str();
  return result.reason.empty() ? kDone : kNotPossible;
}

}  // namespace helix_arm::cli
