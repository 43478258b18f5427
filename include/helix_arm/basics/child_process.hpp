#pragma once

#include <cstddef>
#include <optional>
#include <string>
#include <vector>

#include <sys/types.h>

namespace helix_arm::basics {

/// A program that runs beside this process and does not outlive the object. It starts with default
/// signals in a process group of its own. A socket joins its input and output to this process.
/// Whatever it does, this process goes on.
class ChildProcess {
 public:
  /// @param command  path of the program, then its arguments.
  /// @throws std::system_error if it cannot be started.
  explicit ChildProcess(const std::vector<std::string>& command);
  /// Ends its input, waits a second for it to end, then kills it and all that it started.
  ~ChildProcess();
  ChildProcess(const ChildProcess&) = delete;
  ChildProcess& operator=(const ChildProcess&) = delete;

  /// Writes all of a text. @return false if it reads no more.
  bool send(const std::string& text);
  /// Reads up to `size` bytes as soon as there are some.
  /// @param patience  [ms]
  /// @return the number of bytes; 0 if its output has ended; nothing after the patience.
  std::optional<std::size_t> read(void* bytes, std::size_t size, int patience);
  /// Kills it.
  void kill();
  /// How it ended, as of waitpid(); nothing if it still runs after the patience [ms].
  std::optional<int> status(int patience);

 private:
  pid_t process_ = -1;
  int socket_ = -1;
  std::optional<int> status_;  // once it has ended
};

}  // namespace helix_arm::basics
