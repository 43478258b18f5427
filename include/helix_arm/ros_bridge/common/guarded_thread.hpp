#pragma once

#include <atomic>
#include <functional>
#include <thread>

#include "helix_arm/ros_bridge/common/run_node.hpp"

namespace helix_arm::ros_bridge {

/// A thread whose exceptions do not kill the process unheard: they are printed, and somebody is
/// told.
class GuardedThread {
 public:
  /// Joins a body that must have been told to end.
  ~GuardedThread() { join(); }

  /// @param on_failure  called by the thread, last of all, when the body threw.
  void start(
      std::function<void()> body, std::function<void()> on_failure = [] { EndRequest::make(); });
  void join();

  /// What the node should end with for the body's sake.
  int verdict() const { return verdict_; }

 private:
  std::atomic<int> verdict_{kDone};
  std::thread thread_;
};

}  // namespace helix_arm::ros_bridge
