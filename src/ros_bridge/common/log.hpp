#pragma once

#include <cstdint>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include <ros/console.h>

#include "helix_arm/basics/mutex.hpp"

/// Lines in ROS's log that delay no thread of a node.
///
/// rosconsole writes to the terminal in the thread that logs: a terminal that is stopped, or a pipe
/// that nobody reads, blocks it. While a LogThread exists, which runNode() ensures, the functions
/// below hand their lines over to it. Without one, as in a nodelet of a foreign manager, the caller
/// writes. All of them are thread-safe and format as printf.
///
/// A text of several lines is logged line by line, so that none is without its level and time, and
/// control characters are escaped (basics::printableLines()): text from outside passes for no other
/// line of the log and does not act on the terminal.
namespace helix_arm::ros_bridge {

/// Longest message of another node that is repeated in the log [characters].
inline constexpr std::size_t kLongestMessage = 1000;

using LogLevel = ros::console::Level;

void logLine(LogLevel level, const char* format, ...) __attribute__((format(printf, 2, 3)));
void logInfo(const char* format, ...) __attribute__((format(printf, 1, 2)));
void logWarning(const char* format, ...) __attribute__((format(printf, 1, 2)));
void logError(const char* format, ...) __attribute__((format(printf, 1, 2)));
void logFatal(const char* format, ...) __attribute__((format(printf, 1, 2)));

/// Writes the lines of this process in a thread of its own. At most one at a time.
class LogThread {
 public:
  LogThread();
  /// Returns once the waiting lines are written.
  ~LogThread();
  LogThread(const LogThread&) = delete;
  LogThread& operator=(const LogThread&) = delete;

  /// Queues a line. Thread-safe. If too many are waiting the line is lost, and the log says so.
  void write(LogLevel level, std::string line) HELIX_ARM_EXCLUDES(mutex_);

  /// Waits until all lines are written, at most this long [s]. Required before ros::shutdown(),
  /// after which rosconsole prints nothing.
  /// @return whether they are written.
  bool flush(double longest) HELIX_ARM_EXCLUDES(mutex_);

 private:
  void run();

  basics::Mutex mutex_;
  basics::Condition changed_;
  std::vector<std::pair<LogLevel, std::string>> waiting_ HELIX_ARM_GUARDED_BY(mutex_);
  std::uint64_t lost_ HELIX_ARM_GUARDED_BY(mutex_) = 0;
  bool writing_ HELIX_ARM_GUARDED_BY(mutex_) = false;
  bool ended_ HELIX_ARM_GUARDED_BY(mutex_) = false;
  std::thread thread_;
};

}  // namespace helix_arm::ros_bridge
