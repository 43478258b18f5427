#pragma once

#include <atomic>
#include <functional>
#include <thread>

#include "ros_bridge/common/run_node.hpp"

namespace helix_arm::ros_bridge {

/// A thread whose exceptions do not end the process silently: they are printed and reported.
class GuardedThread {
 public:
  /// Joins; the body must have been told to end.
  ~GuardedThread() { join(); }

  /// @param on_failure  called by the thread as its last action if the body threw.
  void start(
      std::function<void()> body, std::function<void()> on_failure = [] { EndRequest::make(); });
  void join();

  /// Exit code of the node as far as the body is concerned.
  int verdict() const { return verdict_; }

 private:
  std::atomic<int> verdict_{kDone};
  std::thread thread_;
};

}  // namespace helix_arm::ros_bridge
