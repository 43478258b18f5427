#pragma once

#include <Eigen/Core>
#include <atomic>
#include <cstdint>
#include <limits>
#include <memory>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include <sys/types.h>

#include "basics/mutex.hpp"
#include "helix_arm/control/safety.hpp"
#include "regulator_io.hpp"

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

/// I/O rules for a core with these safety rules: the pressure that counts as vented and the time
/// allowed to vent. The rest has its defaults.
IoRules ioRulesOf(const control::SafetyRules& rules);

/// Connects targets to the regulator through the safety core; node, command and tests use the same
/// one. For one thread, or behind one lock.
class PressurePath {
 public:
  /// @param io           null if another node regulates: pass its readings to the core and the
  ///                     orders to it.
  /// @param longest_gap  longest time between turns, > 0 [s]. After a longer one the regulator may
  ///                     have vented by itself, and the link counts as lost.
  /// @throws std::invalid_argument naming the value and its rule.
  PressurePath(control::SafetyCore core, std::unique_ptr<RegulatorIo> io, double longest_gap = 0.4);

  /// Sets the guard, whose state is checked on every turn and before enabling; null: none is
  /// needed.
  void guardedBy(std::shared_ptr<const GuardProcess> guard) { guard_ = std::move(guard); }

  /// One turn at `now`, as steadyNow() [s]: takes readings, lets the core decide, passes on its
  /// orders. Call it often. Neither waits nor allocates.
  const control::ValveOrders& turn(double now);
  /// Like turn(), with a new target: (channels) gauge [Pa]. Returns false, without effect, unless
  /// enabled.
  bool target(double now, const Eigen::Ref<const Eigen::VectorXd>& pressure);

  /// The newest reading if it came with the last turn, otherwise null.
  const Reading* news() const { return fresh_ ? &reading_ : nullptr; }

  /// As SafetyCore::text(), with the line's last error if the line is the cause. Allocates.
  control::SafetyText text() const;
  std::string reason() const { return text().line(core_.state()); }
  /// As SafetyCore::enable(), with the line's last error if there are no readings. Allocates.
  std::string enable(double now);

  control::SafetyCore& core() { return core_; }
  const control::SafetyCore& core() const { return core_; }
  /// Null if another node regulates.
  const RegulatorIo* io() const { return io_.get(); }
  /// As RegulatorIo::end(); false if another node regulates.
  bool end() { return io_ && io_->end(); }

 private:
  void askGuard(double now);

  control::SafetyCore core_;
  Reading reading_;
  bool fresh_ = false;
  double longest_gap_;
  double last_turn_ = std::numeric_limits<double>::infinity();  // so far none [s]
  std::uint64_t breaks_seen_ = 0;
  std::shared_ptr<const GuardProcess> guard_;
  std::unique_ptr<RegulatorIo> io_;
};

}  // namespace helix_arm::regulator
