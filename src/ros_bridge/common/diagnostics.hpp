#pragma once

#include <cstdint>
#include <exception>
#include <functional>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include <diagnostic_msgs/DiagnosticArray.h>
#include <ros/console.h>
#include <ros/node_handle.h>
#include <ros/time.h>

#include "basics/mutex.hpp"
#include "ros_bridge/names.hpp"

namespace helix_arm::io {
struct Scene;
}

/// Reports of a node: lines of ROS's log, warnings of faults, and diagnostics.
namespace helix_arm::ros_bridge {

// Lines in ROS's log delay no thread of a node.
//
// rosconsole writes to the terminal in the thread that logs: a terminal that is stopped, or a pipe
// that nobody reads, blocks it. While a LogThread exists, which runNode() ensures, the functions
// below hand their lines over to it. Without one, as in a nodelet of a foreign manager, the caller
// writes. All of them are thread-safe and format as printf.
//
// A text of several lines is logged line by line, so that none is without its level and time, and
// control characters are escaped (basics::printableLines()): text from outside passes for no other
// line of the log and does not act on the terminal.

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

/// Name of a status: `<node>: <what>`, the node without its leading slash (REP-107).
std::string statusName(const std::string& node, const std::string& what);

/// Appends a key and its value.
void addValue(diagnostic_msgs::DiagnosticStatus& status, const std::string& key,
              const std::string& value);

/// A status of a node. @param what  the part of the node; its name is prepended when published.
diagnostic_msgs::DiagnosticStatus makeStatus(
    const std::string& what, unsigned char level, const std::string& message,
    const std::vector<std::pair<std::string, std::string>>& values = {});

/// Publishes the statuses of a node on /diagnostics, and compares its scene there with those of
/// pressure_command, vision and visual_servo of the same arm. For one thread.
class DiagnosticsPublisher {
 public:
  explicit DiagnosticsPublisher(ros::NodeHandle& node);
  /// The first status tells the scene, and is an error where another node has another one.
  /// @param node  its name. @param scene  its scene.
  void publish(const std::string& node, const io::Scene& scene,
               std::vector<diagnostic_msgs::DiagnosticStatus> statuses);
  /// Which node has had another scene for longer than a reload of all takes, and the remedy; empty
  /// if none has. To be called regularly.
  std::string otherScene(const io::Scene& scene);

 private:
  /// A node of the arm: its last diagnostics.
  struct Peer {
    std::string prefix, scene, sha256;
    ros::SteadyTime heard, differs_since;  ///< zero: not
  };

  void onDiagnostics(const diagnostic_msgs::DiagnosticArrayConstPtr& message);

  std::vector<Peer> peers_;
  ros::Publisher publisher_;
  ros::Subscriber subscriber_;
};

/// The value of a key; empty without it.
std::string valueOf(const diagnostic_msgs::DiagnosticStatus& status, const std::string& key);

/// A number as text with this number of decimals.
std::string fixed(double value, int decimals = 1);

/// Counts faults of one kind and decides when to warn: at the first, then once per period.
class FaultCount {
 public:
  /// Counts a fault. @return true if a warning is due.
  bool add();
  unsigned long total() const { return total_; }

 private:
  unsigned long total_ = 0;
  ros::SteadyTime last_warning_;
};

/// Catches the exceptions of one source of work. Thread-safe.
class FaultGuard {
 public:
  using Log = std::function<void(const std::string& line)>;

  /// @param source  named in the warnings, such as "a message on /tip_target".
  /// @param log     receives the warnings; default: logWarning().
  explicit FaultGuard(std::string source, Log log = {});

  /// @param culprit  the sender; empty if there is none.
  /// @return whether the body returned without throwing; otherwise *why is set to what it threw.
  template <class Body>
  bool run(const std::string& culprit, const Body& body, std::string* why = nullptr) noexcept {
    try {
      body();
      return true;
    } catch (const std::exception& fault) {
      caught(culprit, fault.what(), why);
    } catch (...) {
      caught(culprit, "an exception was thrown that is not a std::exception", why);
    }
    return false;
  }

 private:
  void caught(const std::string& culprit, const char* fault, std::string* why) noexcept;

  const std::string source_;
  const Log log_;
  basics::Mutex mutex_;
  FaultCount faults_ HELIX_ARM_GUARDED_BY(mutex_);
};

}  // namespace helix_arm::ros_bridge
