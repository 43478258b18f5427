#pragma once

#include <atomic>
#include <chrono>
#include <thread>

#include "helix_arm/basics/mutex.hpp"

namespace helix_arm::ros_bridge {

/// Asks the node to end when its ROS master is gone, hangs, or was restarted and no longer knows
/// the node: roscpp notices none of these.
///
/// Asks from a thread of its own, and waits for no answer longer than kPatience: a master that
/// hangs stalls nothing.
class MasterWatch {
 public:
  static constexpr double kPatience = 2;  ///< for an answer [s]

  /// @param period  between two questions.
  /// @param misses  questions in a row without an answer that mean the master is gone, >= 1.
  explicit MasterWatch(std::chrono::milliseconds period = std::chrono::seconds(1), int misses = 3);
  /// Waits kPatience at most.
  ~MasterWatch();
  MasterWatch(const MasterWatch&) = delete;
  MasterWatch& operator=(const MasterWatch&) = delete;

  /// True once the master was found gone and the node was asked to end.
  bool lost() const { return lost_; }

 private:
  void watch(std::chrono::milliseconds period, int misses);

  basics::Mutex mutex_;
  basics::Condition wake_;
  bool stop_ HELIX_ARM_GUARDED_BY(mutex_) = false;
  std::atomic<bool> lost_{false};
  std::thread thread_;
};

}  // namespace helix_arm::ros_bridge
