#pragma once

#include <cstdint>
#include <string>

#include <diagnostic_msgs/DiagnosticStatus.h>
#include <ros/time.h>

/// Diagnostics and warnings common to all nodes.
namespace helix_arm::ros_bridge {

/// Name of a status: `<node>: <what>`, the node without its leading slash (REP-107).
std::string statusName(const std::string& node, const std::string& what);

/// Appends a key and its value.
void addValue(diagnostic_msgs::DiagnosticStatus& status, const std::string& key,
              const std::string& value);
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

}  // namespace helix_arm::ros_bridge
