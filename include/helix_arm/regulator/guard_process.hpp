#pragma once

#include <atomic>
#include <string>
#include <thread>
#include <vector>

#include <sys/types.h>

#include "helix_arm/basics/mutex.hpp"
#include "helix_arm/control/safety.hpp"

namespace helix_arm::regulator {

/// A process that outlives this one, to vent the arm where this one is killed or stands still.
///
/// It is started in a session of its own, so that no signal to this process's group reaches it, and
/// its standard input ends with this process, however that ends. Until then it hears a beat from a
/// thread of its own: a process that is stopped (SIGSTOP, Ctrl-Z, a debugger) falls silent. It
/// answers a beat with a byte on its standard input, which is a socket: one that is stopped itself
/// falls silent too. Once the arm is vented for certain the guard is dismissed.
class GuardProcess {
 public:
  static constexpr char kDismissal = 'q';     ///< what the guard reads when it is to go
  static constexpr char kBeat = '.';          ///< and, until then, all the time
  static constexpr double kBeatPeriod = 0.1;  ///< [s]
  static constexpr int kMissedBeats = 10;     ///< in a row: who does not send them stands still
  static constexpr int kFirstBeats = 50;      ///< until its first answer: it loads a scene
  static constexpr double kDismissTime = 2;   ///< to go once dismissed [s]

  /// @param command            program by its path, and its arguments.
  /// @param realtime_priority  of the thread of beats, as scheduleRealtime() where that is allowed.
  /// @throws std::runtime_error naming the program when it cannot be started.
  explicit GuardProcess(const std::vector<std::string>& command, int realtime_priority = 0);
  /// Leaves it to its task, unless it was dismissed.
  ~GuardProcess();
  GuardProcess(const GuardProcess&) = delete;
  GuardProcess& operator=(const GuardProcess&) = delete;

  /// Whether it stands by: it has answered, answers still, and has neither ended nor been
  /// dismissed. An end is known at once. Of any thread; neither waits nor allocates.
  control::Guard state() const;
  /// Tells it to go, and waits for its end, kDismissTime at most: one that is stopped finds the
  /// dismissal when it wakes up.
  void dismiss();

 private:
  bool hasEnded();
  bool hangsUp() const;
  void beat() const;
  void keepBeating(int realtime_priority);
  bool takeAnswers() const;

  pid_t pid_ = -1;
  int line_ = -1;  ///< other end of its standard input
  basics::Mutex mutex_;
  basics::Condition ends_;
  bool ended_ HELIX_ARM_GUARDED_BY(mutex_) = false;
  std::atomic<bool> answered_{false}, dismissed_{false};
  std::atomic<int> patience_{kFirstBeats};  ///< periods to wait for an answer
  std::thread beats_;
};

}  // namespace helix_arm::regulator
