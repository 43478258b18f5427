#pragma once

#include <cstdint>
#include <string>

#include <diagnostic_msgs/DiagnosticStatus.h>
#include <ros/time.h>

/// What the nodes' diagnostics and warnings have in common.
namespace helix_arm::ros_bridge {

/// Name of a status: `<node>: <what>`, the node without its leading slash (REP-107).
std::string statusName(const std::string& node, const std::string& what);

/// Appends a key and its value.
void addValue(diagnostic_msgs::DiagnosticStatus& status, const std::string& key,
              const std::string& value);

/// A number as text, with so many decimals.
std::string fixed(double value, int decimals = 1);

/// Counts faults of one kind, and tells when to warn of them: at the first, and then once a period.
class FaultCount {
 public:
  /// True when it is time for a warning.
  bool add();
  std::uint64_t total() const { return total_; }

 private:
  std::uint64_t total_ = 0;
  ros::SteadyTime last_warning_;
};

}  // namespace helix_arm::ros_bridge
