#pragma once

#include <array>

#include <signal.h>

namespace helix_arm::cli {

/// Exit code of a command that was interrupted, as a shell gives it for Ctrl-C.
inline constexpr int kInterrupted = 130;

/// While it lives, Ctrl-C and the like are noted instead of ending the process.
class InterruptWatch {
 public:
  InterruptWatch();
  ~InterruptWatch();
  InterruptWatch(const InterruptWatch&) = delete;
  InterruptWatch& operator=(const InterruptWatch&) = delete;

 private:
  static constexpr std::array<int, 3> kSignals{SIGINT, SIGTERM, SIGHUP};
  std::array<struct sigaction, kSignals.size()> before_{};
};

/// Whether one was noted since the last watch began.
bool interrupted();

}  // namespace helix_arm::cli
