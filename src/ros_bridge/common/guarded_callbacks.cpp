#include "guarded_callbacks.hpp"

#include <exception>

#include "helix_arm/basics/quote.hpp"
#include "log.hpp"

namespace helix_arm::ros_bridge {
namespace {

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
