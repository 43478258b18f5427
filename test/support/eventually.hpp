#pragma once

#include <chrono>
#include <thread>

namespace helix_arm::test {

/// Waits for a condition; false when it does not come to hold within the deadline [s].
template <class Condition>
bool eventually(const Condition& condition, double deadline = 60.0) {
  const auto end = std::chrono::steady_clock::now() + std::chrono::duration<double>(deadline);
  while (!condition()) {
    if (std::chrono::steady_clock::now() >= end) return false;
    std::this_thread::sleep_for(std::chrono::milliseconds(2));
  }
  return true;
}

}  // namespace helix_arm::test
