#include "ros_bridge/pressure/target_ledger.hpp"

#include "helix_arm/basics/quote.hpp"
#include "ros_bridge/common/log.hpp"
#include "ros_bridge/common/names.hpp"

namespace helix_arm::ros_bridge {

void TargetLedger::warn(FaultCount& count, const std::string& topic, const std::string& commander,
                        const std::string& message, const char* consequence) {
  news_ = true;
  last_fault_ = topic + " from " + basics::quoted(commander) + ": " + message;
  if (!count.add()) return;
  logWarning("%s (%s, %lu so far)", last_fault_.c_str(), consequence,
             static_cast<unsigned long>(count.total()));
}

void TargetLedger::unreachable(const std::string& topic, const std::string& commander,
                               const std::string& message) {
  warn(unreachable_, topic, commander, message, "out of reach");
}

void TargetLedger::dropped(const std::string& topic, const std::string& commander,
                           const control::Refusal& refusal) {
  warn(dropped_[static_cast<std::size_t>(refusal.fault)], topic, commander, refusal.message,
       "dropped");
}

void TargetLedger::report(diagnostic_msgs::DiagnosticStatus& status) {
  std::uint64_t total = 0;
  for (const FaultCount& count : dropped_) total += count.total();
  status.level =
      news_ ? diagnostic_msgs::DiagnosticStatus::WARN : diagnostic_msgs::DiagnosticStatus::OK;
  status.message = news_ ? last_fault_ : "no target was dropped or out of reach";
  addValue(status, names::kReachedKey, std::to_string(reached_));
  addValue(status, names::kUnreachableKey, std::to_string(unreachable_.total()));
  addValue(status, names::kDroppedKey, std::to_string(total));
  for (int i = 0; i < control::kFaultCount; ++i) {
    addValue(status, names::kDroppedPrefix + std::string(control::nameOf(control::Fault(i))),
             std::to_string(dropped_[i].total()));
  }
  addValue(status, names::kLastFaultKey, last_fault_);
  news_ = false;
}

}  // namespace helix_arm::ros_bridge
