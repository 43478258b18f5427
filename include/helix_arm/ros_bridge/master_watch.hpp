#pragma once

#include <atomic>
#include <chrono>
#include <condition_variable>
#include <mutex>
#include <thread>

namespace helix_arm::ros_bridge {

/// Ends the node when its ROS master is gone, or was restarted and no longer knows the node: roscpp
/// notices neither.
///
/// Asks from a thread of its own, so that a master that hangs cannot stall a control loop.
class MasterWatch {
 public:
  /// @param period  between two questions.
  /// @param misses  questions in a row without an answer that mean the master is gone, >= 1.
  explicit MasterWatch(std::chrono::milliseconds period = std::chrono::seconds(1), int misses = 3);
  ~MasterWatch();
  MasterWatch(const MasterWatch&) = delete;
  MasterWatch& operator=(const MasterWatch&) = delete;

  /// True once the master was found gone and the node was told to shut down.
  bool lost() const { return lost_; }

 private:
  void watch(std::chrono::milliseconds period, int misses);

  std::mutex mutex_;
  std::condition_variable wake_;
  bool stop_ = false;
  std::atomic<bool> lost_{false};
  std::thread thread_;
};

}  // namespace helix_arm::ros_bridge
