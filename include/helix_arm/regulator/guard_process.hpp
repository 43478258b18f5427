#pragma once

#include <string>
#include <vector>

#include <sys/types.h>

namespace helix_arm::regulator {

/// A process that outlives this one, to vent the arm where this one is killed.
///
/// It is started in a session of its own, so that no signal to this process's group reaches it, and
/// its standard input ends with this process, however that ends. Once the arm is vented for certain
/// the guard is dismissed.
class GuardProcess {
 public:
  /// What the guard reads when it is to go, and nothing else.
  static constexpr char kDismissal = 'q';

  /// @param command  program by its path, and its arguments.
  /// @throws std::runtime_error naming the program when it cannot be started.
  explicit GuardProcess(const std::vector<std::string>& command);
  /// Leaves it to its task, unless it was dismissed.
  ~GuardProcess();
  GuardProcess(const GuardProcess&) = delete;
  GuardProcess& operator=(const GuardProcess&) = delete;

  /// Whether it still stands by.
  bool stands();
  /// Tells it to go, and waits for its end.
  void dismiss();

 private:
  pid_t pid_ = -1;
  int line_ = -1;  ///< other end of its standard input
};

}  // namespace helix_arm::regulator
