#include "diagnostics.hpp"

#include <exception>

#include <diagnostic_msgs/DiagnosticArray.h>

#include "helix_arm/basics/quote.hpp"
#include "helix_arm/basics/text.hpp"
#include "log.hpp"
#include "ros_bridge/names.hpp"

namespace helix_arm::ros_bridge {
namespace {

constexpr double kWarningPeriod = 5.0;  // of each kind of fault [s]

// Message of the exception that is being handled.
std::string reason() {
  try {
    throw;
  } catch (const std::exception& fault) {
    return basics::printableLines(fault.what());
  } catch (...) {
    return "an exception was thrown that is not a std::exception";
  }
}

}  // namespace

std::string statusName(const std::string& node, const std::string& what) {
  return node.substr(node.compare(0, 1, "/") == 0 ? 1 : 0) + ": " + what;
}

void addValue(diagnostic_msgs::DiagnosticStatus& status, const std::string& key,
              const std::string& value) {
  diagnostic_msgs::KeyValue entry;
  entry.key = key;
  entry.value = value;
  status.values.push_back(entry);
}

diagnostic_msgs::DiagnosticStatus makeStatus(
    const std::string& what, unsigned char level, const std::string& message,
    const std::vector<std::pair<std::string, std::string>>& values) {
  diagnostic_msgs::DiagnosticStatus out;
  out.name = what;
  out.level = level;
  out.message = message;
  for (const auto& [key, value] : values) addValue(out, key, value);
  return out;
}

DiagnosticsPublisher::DiagnosticsPublisher(ros::NodeHandle& node)
    : publisher_(node.advertise<diagnostic_msgs::DiagnosticArray>(names::kDiagnostics, 10)) {}

void DiagnosticsPublisher::publish(const std::string& node, const std::string& scene,
                                   std::vector<diagnostic_msgs::DiagnosticStatus> statuses) {
  diagnostic_msgs::DiagnosticArray msg;
  msg.header.stamp = ros::Time::now();
  msg.status = std::move(statuses);
  for (auto& status : msg.status) {
    status.name = statusName(node, status.name);
    status.hardware_id = scene;
  }
  publisher_.publish(msg);
}

std::string valueOf(const diagnostic_msgs::DiagnosticStatus& status, const std::string& key) {
  for (const auto& entry : status.values) {
    if (entry.key == key) return entry.value;
  }
  return "";
}

std::string fixed(double value, int decimals) { return basics::format("%.*f", decimals, value); }

bool FaultCount::add() {
  const ros::SteadyTime now = ros::SteadyTime::now();
  if (total_++ > 0 && now - last_warning_ < ros::WallDuration(kWarningPeriod)) return false;
  last_warning_ = now;
  return true;
}

FaultGuard::FaultGuard(std::string source, Log log)
    : source_(std::move(source)),
      log_(log ? std::move(log) : [](const std::string& line) { logWarning("%s", line.c_str()); }) {
}

void FaultGuard::caught(const std::string& culprit, std::string* why) noexcept {
  try {
    const std::string text = reason();
    if (why != nullptr) *why = text;
    const basics::MutexLock lock(mutex_);
    if (!faults_.add()) return;
    log_(source_ + (culprit.empty() ? "" : " from " + culprit) + " was dropped (" +
         std::to_string(faults_.total()) + " so far): " + text);
  } catch (...) {  // out of memory: the next warning has the count
  }
}

}  // namespace helix_arm::ros_bridge
