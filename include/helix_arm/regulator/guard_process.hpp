#pragma once

#include <atomic>
#include <string>
#include <thread>
#include <vector>

#include <sys/types.h>

#include "helix_arm/basics/mutex.hpp"
#include "helix_arm/control/safety.hpp"

namespace helix_arm::regulator {

/// A process that outlives this one and vents the arm if this one is killed or stopped.
///
/// It runs in its own session, so that signals to this process's group do not reach it. Its
/// standard input closes when this process ends, for any reason. Until then a thread of this
/// process sends it beats; a process that is stopped (SIGSTOP, Ctrl-Z, a debugger) sends none. The
/// guard answers each beat with a byte on its standard input, which is a socket, so a stopped guard
/// is noticed too. Once the arm is known to be vented, the guard is dismissed.
class GuardProcess {
 public:
  static constexpr char kDismissal = 'q';     ///< byte that dismisses the guard
  static constexpr char kBeat = '.';          ///< byte sent every kBeatPeriod until then
  static constexpr double kBeatPeriod = 0.1;  ///< [s]
  /// Number of missed beats in a row that mean that the sender has stopped.
  static constexpr int kMissedBeats = 10;
  /// The same before the guard's first answer: it has to load a scene.
  static constexpr int kFirstBeats = 50;
  static constexpr double kDismissTime = 2;  ///< time for the guard to end once dismissed [s]

  /// @param command            path of the program, and its arguments.
  /// @param realtime_priority  priority of the beat thread, as for scheduleRealtime(), if allowed.
  /// @throws std::runtime_error naming the program if it cannot be started.
  explicit GuardProcess(const std::vector<std::string>& command, int realtime_priority = 0);
  /// Closes the guard's standard input; the guard then vents, unless it was dismissed.
  ~GuardProcess();
  GuardProcess(const GuardProcess&) = delete;
  GuardProcess& operator=(const GuardProcess&) = delete;

  /// Whether it is on guard: it has answered, still answers, and has neither ended nor been
  /// dismissed. Its end is noticed immediately. Thread-safe; neither waits nor allocates.
  control::Guard state() const;
  /// Dismisses it and waits for its end, at most kDismissTime. A stopped guard reads the dismissal
  /// when it resumes.
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
  std::atomic<int> patience_{kFirstBeats};  ///< number of periods to wait for an answer
  std::thread beats_;
};

}  // namespace helix_arm::regulator
