#pragma once

#include <map>
#include <memory>
#include <string>
#include <vector>

#include <sys/types.h>

namespace helix_arm::test {

/// A child process with a group of its own, whose stdout and stderr are collected; it does not
/// outlive the object, and is asked to end where this process is killed. The thread that makes one
/// lives as long as it.
class Process {
 public:
  using Variables = std::map<std::string, std::string>;

  /// @param command    the program, looked for on PATH, and its arguments.
  /// @param variables  added to this process's environment.
  /// @throws std::runtime_error when it cannot be started.
  explicit Process(const std::vector<std::string>& command, const Variables& variables = {});
  /// Interrupts the group and, where that does not end it, kills it.
  ~Process();
  Process(const Process&) = delete;
  Process& operator=(const Process&) = delete;

  /// True once the output holds the text; false when it did not within the deadline [s], or the
  /// output ended.
  bool prints(const std::string& text, double deadline = 30.0);

  /// Exit code, 128 + the signal that ended it, or -1 when it still ran at the deadline [s].
  int exitCode(double deadline = 30.0);

  /// To its group.
  void signal(int number) const;
  pid_t id() const { return pid_; }

  /// Writes to its stdin.
  void say(const std::string& text) const;
  /// Ends its stdin.
  void endInput();

  /// All that the calls above have read of what it printed.
  const std::string& output() const { return output_; }
  /// All it has printed so far.
  const std::string& outputNow();

 private:
  bool read(double seconds);
  void drain();

  pid_t pid_ = -1;
  int input_ = -1, pipe_ = -1;
  int exit_code_ = -1;
  std::string output_;
};

/// A TCP port of localhost that was free a moment ago.
int freePort();

/// A ROS master of one's own on a free port.
class Master {
 public:
  Master();
  /// Environment of the processes that are to use it.
  Process::Variables variables() const;
  int port() const { return port_; }
  /// Ends it; start() brings up a new one on the same port.
  void stop() { process_.reset(); }
  void signal(int number) const { process_->signal(number); }
  void start();

 private:
  int port_;
  std::unique_ptr<Process> process_;
};

}  // namespace helix_arm::test
