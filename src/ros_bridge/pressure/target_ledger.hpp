#pragma once

#include <array>
#include <cstdint>
#include <string>

#include <diagnostic_msgs/DiagnosticStatus.h>

#include "helix_arm/control/target_check.hpp"
#include "ros_bridge/common/diagnostics.hpp"

namespace helix_arm::ros_bridge {

/// Counts the results of targets, and warns of bad ones: at most one line per fault and period.
class TargetLedger {
 public:
  void reached() { ++reached_; }

  /// A target out of reach, replaced by the closest one.
  void unreachable(const std::string& topic, const std::string& commander,
                   const std::string& message);

  /// A target that was dropped.
  void dropped(const std::string& topic, const std::string& commander,
               const control::Refusal& refusal);

  /// Adds the counts to a status: WARN if a target was dropped or out of reach since the last call.
  void report(diagnostic_msgs::DiagnosticStatus& status);

 private:
  void warn(FaultCount& count, const std::string& topic, const std::string& commander,
            const std::string& message, const char* consequence);

  std::uint64_t reached_ = 0;
  FaultCount unreachable_;
  std::array<FaultCount, control::kFaultCount> dropped_;
  std::string last_fault_;
  bool news_ = false;
};

}  // namespace helix_arm::ros_bridge
