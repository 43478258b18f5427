#include <cerrno>
#include <chrono>
#include <csignal>
#include <iostream>
#include <sstream>
#include <thread>

#include <unistd.h>

#include "helix_arm/regulator/guard_process.hpp"
#include "helix_arm/regulator/regulator_io.hpp"
#include "regulator_actions.hpp"

namespace helix_arm::cli {
namespace {

using regulator::steadyNow;

constexpr double kTrying = 10;  // [s]
constexpr std::chrono::milliseconds kBetweenTries(50);

// Reads stdin to its end; true where it was told to go.
bool dismissed() {
  char byte = 0;
  for (;;) {
    const ssize_t size = read(STDIN_FILENO, &byte, 1);
    if (size < 0 && errno == EINTR) continue;
    if (size <= 0) return false;
    if (byte == regulator::GuardProcess::kDismissal) return true;
  }
}

// Connects and vents until that is done, for a while.
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
  const auto driver = driverOf(scene);  // what it needs is there before it is needed
  if (dismissed()) return kDone;
  const double begin = steadyNow();
  const Vented result = vent(*driver, scene);
  std::ostringstream line;
  line << "guard: whoever moved the arm is gone; " << regulator::describe(*scene.regulator);
  if (result.reason.empty()) {
    line << " is vented, after " << steadyNow() - begin << " s\n";
  } else {
    line << " is NOT vented: " << result.reason << "\n";
  }
  std::cerr << line.str();
  return result.reason.empty() ? kDone : kNotPossible;
}

}  // namespace helix_arm::cli
