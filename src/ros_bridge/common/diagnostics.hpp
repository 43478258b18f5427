#pragma once

#include <functional>
#include <string>
#include <utility>
#include <vector>

#include <diagnostic_msgs/DiagnosticStatus.h>
#include <ros/node_handle.h>
#include <ros/time.h>

#include "helix_arm/basics/mutex.hpp"

/// Diagnostics and warnings common to all nodes.
namespace helix_arm::ros_bridge {

/// Name of a status: `<node>: <what>`, the node without its leading slash (REP-107).
std::string statusName(const std::string& node, const std::string& what);

/// Appends a key and its value.
void addValue(diagnostic_msgs::DiagnosticStatus& status, const std::string& key,
              const std::string& value);

/// A status of a node. @param what  the part of the node; its name is prepended when published.
diagnostic_msgs::DiagnosticStatus makeStatus(
    const std::string& what, unsigned char level, const std::string& message,
    const std::vector<std::pair<std::string, std::string>>& values = {});

/// Publishes the statuses of a node on /diagnostics.
class DiagnosticsPublisher {
 public:
  explicit DiagnosticsPublisher(ros::NodeHandle& node);
  /// @param node  its name. @param scene  name of the scene.
  void publish(const std::string& node, const std::string& scene,
               std::vector<diagnostic_msgs::DiagnosticStatus> statuses);

 private:
  ros::Publisher publisher_;
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
    } catch (...) {
      caught(culprit, why);
      return false;
    }
  }

 private:
  /// In a handler.
  void caught(const std::string& culprit, std::string* why) noexcept;

  const std::string source_;
  const Log log_;
  basics::Mutex mutex_;
  FaultCount faults_ HELIX_ARM_GUARDED_BY(mutex_);
};

}  // namespace helix_arm::ros_bridge
